"""Which key spheres look like an image, whatever its heading, and how likely chance would show as much.

Each feature of an image votes, for every feature with the same word in a sphere, for the turn about the vertical that
would bring the two together. Features of the same place agree on it, however the vehicle is turned; those of other
places are spread evenly over all turns. So a place is ranked by the Poisson tail of its histogram's peak (after
Chapoulie et al. 2011, M15 section 3.5.2). Rows of like houses are no chance: whoever asks must verify.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrc

from sphere_map.appearance.dictionary import Dictionary
from sphere_map.appearance.features import Features

Floats = NDArray[np.float32]
NUM_BINS = 36  # turns of 10 degrees
WINDOW = 3  # neighbouring turns that count as one: what is near moves as the viewpoint does
MAX_RISE = np.radians(20.0)  # between two views of one feature; a sphere is upright within less
MAX_REPEATS = 4  # of a word in one image; a fence says nothing


@dataclass(frozen=True)
class Likeness:
    """A key sphere that looks like the image: `turn` rad brings the image's azimuths to the sphere's.

    log_chance: natural logarithm of how many spheres of the map would show as many votes if features were scattered.
    """

    sphere_id: int
    turn: float
    num_votes: int
    log_chance: float


class Postings:
    """Where a word was seen: rows (n, 3) of the sphere's row, azimuth and elevation in rad, in an array that grows."""

    def __init__(self) -> None:
        self._rows, self._size = np.empty((4, 3)), 0

    @property
    def rows(self) -> NDArray[np.float64]:
        """What was added so far."""
        return self._rows[: self._size]

    def add(self, row: int, azimuth: float, elevation: float) -> None:
        """Add one place."""
        if self._size == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self._size] = row, azimuth, elevation
        self._size += 1


class AppearanceIndex:
    """Features of all key spheres by word; `features` by id."""

    def __init__(self) -> None:
        self.dictionary = Dictionary()
        self.features: dict[int, Features] = {}
        self.words: dict[int, NDArray[np.int64]] = {}
        self._ids: list[int] = []
        self._postings: dict[int, Postings] = {}  # by word

    def __len__(self) -> int:
        return len(self._ids)

    def add(self, sphere_id: int, features: Features, words: NDArray[np.int64] | None = None) -> None:
        """Add a key sphere; `words` where the dictionary gave them before. ValueError for an id that is taken."""
        if sphere_id in self.features:
            raise ValueError(f"appearance: expected a new key sphere, found {sphere_id} again")
        descriptors = features.unit_descriptors()
        if words is None:
            words = self.dictionary.learn(descriptors)
        else:
            self.dictionary.restore(descriptors, words)
        self.features[sphere_id], self.words[sphere_id] = features, words
        row = len(self._ids)
        self._ids.append(sphere_id)
        azimuth, elevation = angles(features.rays)
        for feature in telling(words).tolist():
            self._postings.setdefault(int(words[feature]), Postings()).add(row, azimuth[feature], elevation[feature])

    def find(self, features: Features, count: int, without: Iterable[int] = ()) -> list[Likeness]:
        """Return up to `count` key spheres, the likest first; rays of the image in axes about upright (z up)."""
        votes = self._votes(features)
        if not votes.size:
            return []
        number = votes.sum(axis=1)
        shifts = range(-(WINDOW // 2), WINDOW // 2 + 1)
        peaks = np.sum([np.roll(votes, shift, axis=1) for shift in shifts], axis=0)
        best = np.argmax(peaks, axis=1)
        height = peaks[np.arange(len(best)), best]
        chance = pdtrc(height - 1, np.maximum(number * WINDOW / NUM_BINS, 1e-9))  # Poisson: as many or more
        log_chance = np.log(np.maximum(chance, np.finfo(np.float64).tiny)) + np.log(NUM_BINS * len(self._ids))
        hidden = set(without)
        order = np.lexsort((np.arange(len(best)), -height, log_chance))
        rows = [row for row in order.tolist() if self._ids[row] not in hidden and height[row] > 0][:count]
        turns = 2 * np.pi * (best + 0.5) / NUM_BINS - np.pi
        return [Likeness(self._ids[row], float(turns[row]), int(height[row]), float(log_chance[row])) for row in rows]

    def _votes(self, features: Features) -> NDArray[np.int64]:
        """Return the histogram (S, NUM_BINS) of turns for every sphere; a feature votes once for each turn."""
        words = self.dictionary.read(features.unit_descriptors())
        azimuth, elevation = angles(features.rays)
        cells = []
        for feature in telling(words).tolist():
            postings = self._postings.get(int(words[feature]))
            if postings is None:
                continue
            entries = postings.rows
            near = entries[np.abs(entries[:, 2] - elevation[feature]) < MAX_RISE]
            turn = (near[:, 1] - azimuth[feature] + np.pi) % (2 * np.pi)
            turn_bin = np.minimum((turn * (NUM_BINS / (2 * np.pi))).astype(np.int64), NUM_BINS - 1)
            cells.append(np.unique(near[:, 0].astype(np.int64) * NUM_BINS + turn_bin))
        total = (
            np.bincount(np.concatenate(cells), minlength=len(self._ids) * NUM_BINS) if cells else np.zeros(0, np.int64)
        )
        return total.reshape(-1, NUM_BINS)


def angles(rays: Floats) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return azimuth and elevation (N,) in rad of unit rays (N, 3) in body axes."""
    rays = rays.astype(np.float64)
    return np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(np.clip(rays[:, 2], -1.0, 1.0))


def telling(words: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows of features whose word is known and not repeated all over the image."""
    known = np.flatnonzero(words >= 0)
    _, inverse, counts = np.unique(words[known], return_inverse=True, return_counts=True)
    return known[counts[inverse] <= MAX_REPEATS]
