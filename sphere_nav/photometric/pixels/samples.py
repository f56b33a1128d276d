"""A few thousand pixels of an alignment, warped into the image, by which its residuals are checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.photometric.align.alignment import Alignment
from sphere_nav.photometric.align.iteration import kernels
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.align.projection import Floats, KernelCamera, kernel_motion, rolling
from sphere_nav.photometric.constants import NUM_SAMPLES, TYPICAL_QUANTILE
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Level, Pyramid
from sphere_nav.photometric.pixels.reference import Selection, View
from sphere_nav.photometric.pixels.selection import choose_pixels


@dataclass(frozen=True)
class Sample:
    """Pixels of one view: points (N, 3) m in the camera, gradients by the point (N, 3) in both images, residuals (N,).

    by_stretch (N,) is the derivative of the residual by the stretch, current (N,) the grey level of the image,
    at (N, 2) the place in it, -1...1 on both axes.
    """

    points: Array
    of_reference: Array
    of_image: Array
    by_stretch: Array
    current: Array
    residual: Array
    at: Array

    @property
    def by_pose(self) -> Array:
        """Derivative (N, 6) of the residual by xi in T_world_camera exp(xi)."""
        return np.hstack([-self.of_image, np.cross(self.of_image, self.points)])

    def where(self, chosen: NDArray[np.bool_]) -> Sample:
        """Return some of the pixels, chosen (N,)."""
        return Sample(*(getattr(self, part.name)[chosen] for part in fields(self)))


CameraSamples = Sequence[
    tuple[SE3 | None, Sequence[Sample]]
]  # T_body_camera (None: it is the body), pixels of its views
Sampler = Callable[[SE3], CameraSamples]  # gives the pixels at another T_world_body


def cosines(sample: Sample) -> tuple[Array, Array]:
    """Return the cosine (N,) between the gradients of image and reference, and how strong (N,) those of the latter are.

    By direction alone in the image: what covers a part of the view counts by its share, not by its contrast.
    """
    length, in_reference, in_image = (
        np.sqrt(np.einsum("ni,ni->n", rows, rows)) for rows in (sample.points, sample.of_reference, sample.of_image)
    )
    product = np.einsum("ni,ni->n", sample.of_reference, sample.of_image)
    return product / np.maximum(in_reference * in_image, TINY), length * in_reference


class CellCosines(NamedTuple):
    """Of pixels (N,) their cell, `cosines` and weight; of each cell its weight, its mean, whether it has enough."""

    cell: NDArray[np.int64]
    cosine: Array
    weight: Array
    total: Array
    mean: Array
    known: NDArray[np.bool_]

    @property
    def typical(self) -> float:
        """The mean of the cells that show what the references do; 0: no cell is known."""
        return float(np.quantile(self.mean[self.known], TYPICAL_QUANTILE)) if self.known.any() else 0.0


def cosines_by_cell(samples: Sequence[Sample], cells: tuple[int, int], least: int) -> CellCosines:
    """Return the cosines of all views by cells (columns, rows) of the image; known are those of `least` pixels."""
    number = math.prod(cells)
    cell = np.concatenate([np.zeros(0, np.int64), *(cell_of(one, cells) for one in samples)])
    parts = [np.zeros((2, 0)), *(np.stack(cosines(one)) for one in samples)]
    cosine, weight = np.concatenate(parts, axis=1)
    total, agreeing = (np.asarray(np.bincount(cell, one, number), np.float64) for one in (weight, weight * cosine))
    known = (np.bincount(cell, minlength=number) >= least) & (total > 0.0)
    return CellCosines(cell, cosine, weight, total, agreeing / np.maximum(total, TINY), known)


def cell_of(sample: Sample, cells: tuple[int, int]) -> NDArray[np.int64]:
    """Return in which cell (columns, rows) of the image each pixel (N,) is, row by row."""
    column, row = np.clip((0.5 * (sample.at + 1.0) * cells).astype(np.int64), 0, np.array(cells) - 1).T
    return row * cells[0] + column


def sample_views(
    pyramid: Pyramid,
    views: Sequence[View],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None,
) -> list[Sample]:
    """Return some pixels of each view, warped into the image."""
    level = pyramid.levels[min(params.pyramid.finest, len(pyramid.levels) - 1)]
    camera = level.kernel_camera if motion is None else rolling(level.camera, motion.twist(alignment.T_world_camera))
    T_camera_world = alignment.T_world_camera.inverse()
    samples = []
    for view, gain, bias in zip(views, alignment.gains, alignment.biases, strict=True):
        T = T_camera_world @ view.T_world_reference
        pixels = view.reference.level_like(level.camera)
        selection = choose_pixels(pixels, T, level.camera, params.max_pixels // len(views))
        blocks = thin_blocks(selection, NUM_SAMPLES // len(views))
        samples.append(warp_sample(blocks, kernel_motion(T.matrix), camera, level, (gain, bias)))
    return samples


def thin_blocks(selection: Selection, number: int) -> Floats:
    """Return blocks of about so many of the chosen pixels, evenly taken."""
    step = max(1, selection.num_pixels // number)
    some = selection.blocks.reshape(selection.blocks.size // BLOCK, BLOCK // SIDE, SIDE)[:, :, ::step]
    rows = some.transpose(1, 0, 2).reshape(BLOCK // SIDE, some.shape[0] * some.shape[2])
    count = -(-rows.shape[1] // SIDE)
    blocks = np.full((BLOCK // SIDE, count * SIDE), np.nan, np.float32)
    blocks[:, : rows.shape[1]] = rows
    return np.ascontiguousarray(blocks.reshape(BLOCK // SIDE, count, SIDE).swapaxes(0, 1)).reshape(-1)


def warp_sample(blocks: Floats, T: Floats, camera: KernelCamera, level: Level, light: tuple[float, float]) -> Sample:
    """Warp pixels of a reference into the image."""
    height, width = level.camera.height, level.camera.width
    gain, bias, *center = (np.float32(value) for value in (*light, 0.5 * (width - 1), 0.5 * (height - 1)))
    out = np.empty((kernels.NUM_WARPED, blocks.size // BLOCK * SIDE), np.float32)
    kernels.warp(blocks, T, camera, level.samples, gain, bias, *center, out)
    seen = out[:-1, out[-1] > 0.0].astype(np.float64)
    points, of_reference, of_image = (np.ascontiguousarray(rows.T) for rows in np.split(seen[:9], 3))
    at = (level.camera.project(points)[0] - center) / center
    by_stretch, current, residual = seen[9:]
    return Sample(points, of_reference, of_image, by_stretch, current, residual, at)
