"""Which parts of a view show the map, how far each of them is shifted, and could as many agree by chance?

Each cell of a grid is asked: of all shifts of the image by up to `REACH` pixels, at which do gradients of image and
references agree best (block matching)? At none where the cell shows the map and the pose is right; where the pose is a
little off, at the one that the motion makes there; at any one where it shows something else, or where the place is
wrong. In a wrong place the cells whose best shift is none are therefore binomial (a contrario, Desolneux et al.): no
threshold of likeness, but a chance. A pose has six numbers, so a fit alone can bring `FITTED_CELLS` to agree; they do
not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.geometry.so3 import hat
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.constants import (
    FITTED_CELLS,
    MIN_PART_PIXELS,
    NEAR_SHIFT,
    PARTS,
    REACH,
    STRENGTH_QUANTILE,
)
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.parts import kernels
from sphere_nav.photometric.pixels.samples import Sample, cell_of, sum_by_cell

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
    return Votes(sample, cell, count >= MIN_PART_PIXELS, _best_shifts(scores))


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
