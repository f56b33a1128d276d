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
from sphere_nav.photometric.pixels.pyramid import Level
from sphere_nav.photometric.pixels.samples import CameraSamples, Sample

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


class _Looked(NamedTuple):
    """Which cells have pixels enough, the shift (cells, 2) px at which each agrees best, the cell of each pixel.

    by_point (N, 2, 3): where each pixel falls, by its point.
    """

    is_known: NDArray[np.bool_]
    shift: Array
    cell: NDArray[np.int64]
    by_point: Array

    @property
    def agrees(self) -> NDArray[np.bool_]:
        """Which cells agree where they are."""
        return np.asarray(self.is_known & (np.abs(np.rint(self.shift)).max(axis=1) <= NEAR_SHIFT))


@dataclass(frozen=True, eq=False)
class Votes:
    """How many cells of all images there are, how many agree, and the looks at pixels of cameras that tell it."""

    num_cells: int
    num_agreeing: int
    looks: Sequence[_Looked] = ()
    cameras: CameraSamples = ()

    @cached_property
    def kept(self) -> CameraSamples:
        """The pixels in cells that agree."""
        pairs = zip(self.looks, self.cameras, strict=True)
        return [(place, one.where(found.agrees[found.cell])) for found, (place, one) in pairs]

    @cached_property
    def owner(self) -> NDArray[np.int64]:
        """The cell of each pixel of `kept`, in the order of the images."""
        return np.concatenate([k * COLUMNS * ROWS + one.cell[one.agrees[one.cell]] for k, one in enumerate(self.looks)])

    @cached_property
    def shifts(self) -> Shifts:
        """How far the cells of all images are shifted, by what was looked at for the votes."""
        shifts, by_pose = [np.zeros((0, 2))], [np.zeros((0, 2, 6))]
        for found, (place, sample) in zip(self.looks, self.cameras, strict=True):
            J = np.concatenate([-found.by_point, found.by_point @ hat(sample.points)], axis=-1)  # of exp(-xi) p
            mean = np.zeros((COLUMNS * ROWS, 2, 6))
            np.add.at(mean, found.cell, np.nan_to_num(J))
            mean /= np.maximum(np.bincount(found.cell, minlength=len(mean)), 1)[:, None, None]
            shifts.append(found.shift[found.is_known])
            by_pose.append((mean @ place.inverse().adjoint())[found.is_known])
        return Shifts(np.concatenate(shifts), np.concatenate(by_pose))

    @property
    def chance(self) -> float:
        """The probability that as many agree in a wrong place."""
        from scipy.special import bdtrc  # what only reads bags does without it

        number, agreeing = self.num_cells - FITTED_CELLS, self.num_agreeing - FITTED_CELLS
        return float(bdtrc(agreeing - 1, number, P_NEAR)) if agreeing > 0 else 1.0


def finest_levels(images: Sequence[RigImage], params: RegistrationParams) -> list[Level]:
    """Return the level of each image that pixels are sampled of."""
    return [image.level(params.pyramid.finest) for image in images]


def vote(levels: Sequence[Level], cameras: CameraSamples) -> Votes:
    """Return which cells of each image agree, where its pixels are."""
    looks = [_look(level, sample) for level, (_, sample) in zip(levels, cameras, strict=True)]
    num_cells = sum(int(found.is_known.sum()) for found in looks)
    num_agreeing = sum(int(found.agrees.sum()) for found in looks)
    return Votes(num_cells, num_agreeing, looks, cameras)


def _look(level: Level, sample: Sample) -> _Looked:
    """Return what the cells of an image say, by the pixels of all its views."""
    camera, number, margin = level.camera, COLUMNS * ROWS, REACH + 1
    scores = np.zeros((number, 2 * REACH + 1, 2 * REACH + 1))
    place, by_point = np.nan_to_num(camera.project(sample.points)[0]), camera.J_project(sample.points)
    gradient = _by_pixel(by_point, sample.of_reference)
    column, row = np.rint(place).astype(np.int32).T
    cell = (row * ROWS // camera.height * COLUMNS + column * COLUMNS // camera.width).clip(0, number - 1)
    inside = (column >= margin) & (column < camera.width - margin) & (row >= margin) & (row < camera.height - margin)
    strength = np.linalg.norm(gradient, axis=1)
    direction = (gradient / np.maximum(strength, TINY)[:, None]).astype(np.float32)
    limit = np.quantile(strength, STRENGTH_QUANTILE) if len(strength) else 0.0
    weight = np.minimum(strength, limit).astype(np.float32)
    pixels = column[inside] + np.int32(level.pad), row[inside], direction[inside], weight[inside]
    kernels.score_shifts(level.image, *pixels, cell[inside], REACH, scores)
    is_known = np.bincount(cell[inside], minlength=number) >= MIN_PART_PIXELS
    return _Looked(is_known, _best_shifts(scores), cell.astype(np.int64), by_point)


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
