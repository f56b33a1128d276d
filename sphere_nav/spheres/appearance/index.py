"""Which key spheres look like an image, whatever its heading, and how likely chance would show as much.

Each feature of an image votes, for every feature with the same word in a sphere, for the turn about the vertical that
would bring the two together. Features of the same place agree on it, however the vehicle is turned; those of other
places are spread evenly over all turns. So a place is ranked by the Poisson tail of its histogram's peak (after
Chapoulie et al. 2011, M15 section 3.5.2). Rows of like houses are no chance: whoever asks must verify.
"""

from __future__ import annotations

from collections.abc import Iterable, MutableMapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import TINY, Array, Floats, Integers
from sphere_nav.spheres.appearance.dictionary import Dictionary
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.constants import MAX_REPEATS, MAX_RISE, NUM_TURN_BINS, TURN_WINDOW


@dataclass(frozen=True)
class Likeness:
    """A key sphere that looks like the image.

    log_chance: natural logarithm of how many spheres of the map would show as many votes if features were scattered.
    """

    sphere_id: int
    log_chance: float


class AppearanceIndex:
    """Features of all key spheres by word; `features` by id."""

    def __init__(self, features: MutableMapping[int, Features] | None = None) -> None:
        """`features` keeps those of every sphere, in memory unless told otherwise."""
        self.dictionary = Dictionary()
        self.features: MutableMapping[int, Features] = {} if features is None else features
        self.words: dict[int, Integers] = {}
        self._ids: list[int] = []
        self._seen: list[tuple[Integers, NDArray[np.int32], Floats]] = []  # words, row, where they stand

    def __len__(self) -> int:
        return len(self._ids)

    def add(self, sphere_id: int, features: Features, words: Integers | None = None) -> None:
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
        seen, places = telling(words), angles(features.rays)
        self._seen.append((words[seen], np.full(len(seen), row, np.int32), places[seen].astype(np.float32)))

    def find(self, features: Features, count: int, without: Iterable[int] = ()) -> list[Likeness]:
        """Return up to `count` key spheres, the likest first; rays of the image in axes about upright (z up)."""
        if not self._ids:
            return []
        votes = self._votes(features)
        number = votes.sum(axis=1)
        shifts = range(-(TURN_WINDOW // 2), TURN_WINDOW // 2 + 1)
        peaks = np.sum([np.roll(votes, shift, axis=1) for shift in shifts], axis=0)
        height = peaks.max(axis=1)
        log_chance = log_tail(height, number * TURN_WINDOW / NUM_TURN_BINS) + np.log(NUM_TURN_BINS * len(self._ids))
        hidden = set(without)
        order = np.lexsort((np.arange(len(height)), -height, log_chance))
        rows = [row for row in order.tolist() if self._ids[row] not in hidden and height[row] > 0][:count]
        return [Likeness(self._ids[row], float(log_chance[row])) for row in rows]

    def _votes(self, features: Features) -> Integers:
        """Return the histogram (S, NUM_TURN_BINS) of turns for every sphere; a feature votes once for each turn."""
        words = self.dictionary.read(features.unit_descriptors())
        asked = telling(words)
        own = angles(features.rays)[asked]
        seen_words, rows, seen = (np.concatenate(parts) for parts in zip(*self._seen, strict=True))
        feature, place = pair_words(words[asked], seen_words, len(self.dictionary))
        near = np.abs(seen[place, 1] - own[feature, 1]) < MAX_RISE
        feature, place = feature[near], place[near]
        turn = (seen[place, 0] - own[feature, 0] + np.pi) % (2 * np.pi)
        turn_bin = np.minimum((turn * (NUM_TURN_BINS / (2 * np.pi))).astype(np.int64), NUM_TURN_BINS - 1)
        cell, size = rows[place].astype(np.int64) * NUM_TURN_BINS + turn_bin, len(self._ids) * NUM_TURN_BINS
        total = np.bincount(np.unique(feature * size + cell) % size, minlength=size)
        return total.reshape(-1, NUM_TURN_BINS)


def pair_words(one: Integers, other: Integers, number: int) -> tuple[Integers, Integers]:
    """Return the places in both lists, of words below `number`, of all pairs that are the same word."""
    from scipy.sparse import csr_array  # what only reads bags does without it

    def table(words: Integers) -> Any:
        return csr_array((np.ones(len(words), np.int8), words, np.arange(len(words) + 1)), (len(words), number))

    second, first = (table(other) @ table(one).T).nonzero()  # the other list is the longer one: it is not turned
    return first.astype(np.int64), second.astype(np.int64)


def log_tail(counts: Integers, means: Array) -> Array:
    """Return the natural logarithm (N,) of how likely Poisson variables of these means are as large or larger.

    The sum m^k / k! from the count on, by its first term: no chance is too small to be told from another.
    """
    means = np.maximum(means, TINY)
    log_factorials = np.append(0.0, np.cumsum(np.log(np.arange(1, int(np.max(counts, initial=0)) + 1))))
    first = counts * np.log(means) - means - log_factorials[counts]
    total, term, k = np.ones(len(means)), np.ones(len(means)), counts.copy()
    while np.any(term > TINY * total):
        k += 1
        term *= means / k
        total += term
    return np.minimum(first + np.log(total), 0.0)


def angles(rays: Floats) -> Array:
    """Return azimuth and elevation (N, 2) in rad of unit rays (N, 3) in body axes."""
    rays = rays.astype(np.float64)
    return np.column_stack([np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(np.clip(rays[:, 2], -1.0, 1.0))])


def telling(words: Integers) -> Integers:
    """Return the rows of features whose word is known and not repeated all over the image."""
    known = np.flatnonzero(words >= 0)
    _, inverse, counts = np.unique(words[known], return_inverse=True, return_counts=True)
    return known[counts[inverse] <= MAX_REPEATS]
