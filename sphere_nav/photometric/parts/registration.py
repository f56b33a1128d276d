"""Images aligned by their parts, coarse to fine: where light has changed so much that grey levels say nothing.

Shadows, lamps, snow and cars that stand elsewhere change most of a view, and turn the contrast of some of it. Grey
levels then have no common minimum, but edges of what has stayed are where they were. At each level cells are matched
(`vote`) and the motion on which most agree is taken (`fit_motion`); at the finest one the votes are the evidence.

Each cell of a grid is asked: of all shifts of the image by up to `REACH` pixels, at which do gradients of image and
references agree best (block matching)? At none where the cell shows the map and the pose is right; where the pose is a
little off, at the one that the motion makes there; at any one where it shows something else, or where the place is
wrong. In a wrong place the cells whose best shift is none are therefore binomial (a contrario, Desolneux et al.): no
threshold of likeness, but a chance. A pose has six numbers, so a fit alone can bring `FITTED_CELLS` to agree; they do
not count.

Where a pose is some pixels off, no cell agrees without a shift. But the cells that show the map are all shifted as one
motion shifts them (RANSAC): motions are fitted to sets of three cells, each set counted as one try.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.least_squares import RIDGE, scaled_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.geometry.so3 import hat
from sphere_nav.photometric.align.esm import UNKNOWN
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.constants import (
    FITTED_CELLS,
    MIN_CELL_PIXELS,
    MIN_PARTS_SIDE,
    MIN_SHIFT_SIGMA_PX,
    MIN_VIEW_PIXELS,
    NEAR_SHIFT,
    NUM_TRIED_MOTIONS,
    PART_ROUNDS,
    PARTS,
    REACH,
    STRENGTH_QUANTILE,
    SURE_CHANCE,
)
from sphere_nav.photometric.params import RegistrationParams, between
from sphere_nav.photometric.parts import kernels
from sphere_nav.photometric.pixels.samples import Sample, cell_of, sample_images, sum_by_cell

COLUMNS, ROWS = PARTS
P_NEAR = float((2 * NEAR_SHIFT + 1) ** 2 / (2 * REACH + 1) ** 2)  # that the best of all shifts is none, by chance
LARGEST_PART = 0.49  # px between two shifts, so that rounding gives the shift that was best


class Shifts(NamedTuple):
    """Of N cells how far each is shifted, (N, 2) px, and its derivative (N, 2, 6) by xi of the body."""

    shift: Array
    by_pose: Array

    @property
    def number(self) -> int:
        """How many cells there are."""
        return len(self.shift)


@dataclass(frozen=True, eq=False)
class Votes:
    """What the cells of all images say, by pixels (N,) each in a cell (N,): image by image, row by row.

    Which cells have pixels enough, and the shift (cells, 2) px at which each agrees best.
    """

    sample: Sample
    cell: NDArray[np.int64]
    is_known: NDArray[np.bool_]
    shift: Array

    @cached_property
    def agrees(self) -> NDArray[np.bool_]:
        """Which cells agree where they are."""
        return np.asarray(self.is_known & (np.abs(np.rint(self.shift)).max(axis=1) <= NEAR_SHIFT))

    @property
    def kept(self) -> Sample:
        """The pixels in cells that agree."""
        return self.sample.where(self.agrees[self.cell])

    @property
    def owner(self) -> NDArray[np.int64]:
        """The cell of each pixel of `kept`."""
        return self.cell[self.agrees[self.cell]]

    @property
    def shifts(self) -> Shifts:
        """How far the cells are shifted."""
        by_point = self.sample.by_point
        J = np.concatenate([-by_point, by_point @ hat(self.sample.points)], axis=-1)  # of exp(-xi) p
        number = np.maximum(np.bincount(self.cell, minlength=len(self.shift)), 1)
        mean = sum_by_cell(self.cell, J, len(self.shift)) / number[:, None, None]
        return Shifts(self.shift[self.is_known], mean[self.is_known])

    @property
    def chance(self) -> float:
        """The probability that as many agree in a wrong place."""
        return chance_of(int(self.is_known.sum()), int(self.agrees.sum()))


def chance_of(num_cells: int, num_agreeing: int) -> float:
    """Return the probability that so many cells, or more, agree in a wrong place."""
    from scipy.special import bdtrc  # what only reads bags does without it

    number, agreeing = num_cells - FITTED_CELLS, num_agreeing - FITTED_CELLS
    return float(bdtrc(agreeing - 1, number, P_NEAR)) if agreeing > 0 else 1.0


def vote(images: Sequence[RigImage], params: RegistrationParams, sample: Sample) -> Votes:
    """Return which cells of images agree, where the pixels of all their views are."""
    number, margin, cell = len(images) * COLUMNS * ROWS, REACH + 1, cell_of(sample, PARTS)
    scores, count = np.zeros((number, 2 * REACH + 1, 2 * REACH + 1)), np.zeros(number, np.int64)
    gradient = _by_pixel(sample.by_point, sample.of_reference)
    strength = np.linalg.norm(gradient, axis=1)
    direction = (gradient / np.maximum(strength, TINY)[:, None]).astype(np.float32)
    limit = np.quantile(strength, STRENGTH_QUANTILE) if len(strength) else 0.0
    weight = np.minimum(strength, limit).astype(np.float32)
    for index, image in enumerate(images):
        level = image.level(params.pyramid.finest)
        size = np.array([level.camera.width, level.camera.height])
        place = np.rint(0.5 * (sample.at + 1.0) * (size - 1)).astype(np.int32)
        own = (sample.image == index) & np.all((place >= margin) & (place < size - margin), axis=1)
        pixels = place[own, 0] + np.int32(level.pad), place[own, 1], direction[own], weight[own]
        kernels.score_shifts(level.image, *pixels, cell[own], REACH, scores)
        count += np.bincount(cell[own], minlength=number)
    return Votes(sample, cell, count >= MIN_CELL_PIXELS, _best_shifts(scores))


def _best_shifts(scores: Array) -> Array:
    """Return the shift (cells, 2) px of the highest of scores (cells, rows, columns), between pixels by a parabola."""
    cell, last = np.arange(len(scores)), scores.shape[1] - 1
    down, across = np.unravel_index(scores.reshape(len(scores), -1).argmax(axis=1), scores.shape[1:])
    best, found = scores[cell, down, across], []
    for before, after, place in (
        (scores[cell, down, np.maximum(across - 1, 0)], scores[cell, down, np.minimum(across + 1, last)], across),
        (scores[cell, np.maximum(down - 1, 0), across], scores[cell, np.minimum(down + 1, last), across], down),
    ):
        is_inside = (place > 0) & (place < last)
        part = 0.5 * (before - after) / np.minimum(before - 2.0 * best + after, -TINY)
        found.append(place - REACH + np.where(is_inside, np.clip(part, -LARGEST_PART, LARGEST_PART), 0.0))
    return np.stack(found, axis=-1)


def _by_pixel(J: Array, of_reference: Array) -> Array:
    """Return gradients by the point (N, 3) as ones by px (N, 2), where J (N, 2, 3) is the pixel by the point."""
    a, b = J[:, 0], J[:, 1]
    aa, ab, bb = (np.einsum("ni,ni->n", *pair) for pair in ((a, a), (a, b), (b, b)))
    ga, gb = np.einsum("ni,ni->n", a, of_reference), np.einsum("ni,ni->n", b, of_reference)
    found = np.stack([bb * ga - ab * gb, aa * gb - ab * ga], axis=-1) / np.maximum(aa * bb - ab**2, TINY)[:, None]
    return np.nan_to_num(found)


def fit_motion(cells: Shifts) -> Array | None:
    """Return xi (6,) that shifts as many cells as possible as they are shifted; None where there are too few."""
    if cells.number <= FITTED_CELLS:
        return None
    tries = _draw(cells.number)
    J, shift = cells.by_pose[tries].reshape(len(tries), -1, 6), cells.shift[tries].reshape(len(tries), -1)
    size = np.sqrt(np.mean(J**2, axis=1, keepdims=True)) + TINY  # meters and radians are not alike
    J = J / size
    H = np.swapaxes(J, 1, 2) @ J + RIDGE * np.eye(6)
    motions = np.linalg.solve(H, np.swapaxes(J, 1, 2) @ shift[..., None])[..., 0] / size[:, 0]
    counts = agreeing(cells, motions).sum(axis=1)
    agrees = agreeing(cells, motions[[np.argmax(counts)]])[0]
    if agrees.sum() <= FITTED_CELLS:
        return None
    J, shift = cells.by_pose[agrees].reshape(-1, 6), cells.shift[agrees].reshape(-1)
    return np.asarray(scaled_inverse(J.T @ J) @ J.T @ shift)


@lru_cache(16)
def _draw(number: int) -> NDArray[np.int64]:
    """Return sets of three of so many cells, always the same."""
    order = np.argsort(np.random.default_rng(0).random((NUM_TRIED_MOTIONS, number)), axis=1)
    return np.asarray(order[:, :FITTED_CELLS])


def motion_covariance(cells: Shifts) -> Array:
    """Return the covariance (6, 6) of a pose at which cells are shifted so, by those that agree there."""
    agrees = agreeing(cells, np.zeros((1, 6)))[0]
    if agrees.sum() <= FITTED_CELLS:
        return UNKNOWN.copy()
    J, shift = cells.by_pose[agrees].reshape(-1, 6), cells.shift[agrees].reshape(-1)
    variance = max(float(np.mean(shift**2)), MIN_SHIFT_SIGMA_PX**2)
    return np.asarray(variance * scaled_inverse(J.T @ J))


def agreeing(cells: Shifts, motions: Array) -> NDArray[np.bool_]:
    """Return which of N cells each of M motions shifts as they are shifted, (M, N)."""
    off = np.einsum("nij,mj->mni", cells.by_pose, motions) - cells.shift
    return np.asarray(np.abs(off).max(axis=2) <= NEAR_SHIFT)


@dataclass(frozen=True, eq=False)
class PartsAlignment:
    """T_world_body, its covariance (6, 6), and the chance of as many agreeing cells in a wrong place.

    All motions that were tried are counted in it.
    """

    T_world_body: SE3
    covariance: Array
    chance: float


def register_parts(images: Sequence[RigImage], T_world_body: SE3, params: RegistrationParams) -> PartsAlignment:
    """Align images of one body to their references from a first guess; `chance` says whether to believe it.

    It is begun at each level whose sides have `MIN_PARTS_SIDE` pixels, the coarsest first, which finds what is farthest
    off (`REACH` pixels of it), but has the fewest cells; the one that most speaks for counts.
    """
    levels = _usable_levels(images, params)
    best: PartsAlignment | None = None
    for number in range(len(levels), 0, -1):
        found = _descend(images, T_world_body, params, levels[:number], len(levels))
        best = found if best is None or found.chance < best.chance else best
        if best.chance <= SURE_CHANCE:
            break
    assert best is not None
    return best


def _descend(
    images: Sequence[RigImage], T_world_body: SE3, params: RegistrationParams, levels: Sequence[int], num_begun: int
) -> PartsAlignment:
    """Return the alignment through levels, the coarsest first; `num_begun` such are tried."""
    for level in reversed(levels):
        own = between(params, finest=level)
        for _ in range(PART_ROUNDS):
            xi = fit_motion(_vote(images, own, T_world_body).shifts)
            if xi is None:
                break
            T_world_body = T_world_body @ SE3.exp(xi)
    votes = _vote(images, params, T_world_body)
    covariance = motion_covariance(votes.shifts)
    chance = min(votes.chance * NUM_TRIED_MOTIONS * num_begun, 1.0)
    return PartsAlignment(T_world_body, covariance, chance)


def _usable_levels(images: Sequence[RigImage], params: RegistrationParams) -> list[int]:
    """Return the levels of which cells can be matched, the finest in any case."""
    finest, coarsest = params.pyramid.finest, min(len(image.pyramid.levels) for image in images) - 1
    cameras = [[image.pyramid.levels[level].camera for image in images] for level in range(coarsest + 1)]
    sides = [min(side for one in level for side in (one.width, one.height)) for level in cameras]
    wide = [level for level in range(finest, coarsest + 1) if sides[level] >= MIN_PARTS_SIDE]
    return wide or [min(finest, coarsest)]


def _vote(images: Sequence[RigImage], params: RegistrationParams, T_world_body: SE3) -> Votes:
    """Return how the cells of images agree at a pose; light is not asked."""
    light = np.tile([1.0, 0.0], (sum(len(image.views) for image in images), 1))
    return vote(images, params, sample_images(images, T_world_body, light, params).of_views(MIN_VIEW_PIXELS))
