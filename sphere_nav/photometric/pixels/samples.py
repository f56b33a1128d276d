"""A few thousand pixels of an alignment, warped into the image, by which its residuals are checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.photometric.align.iteration import kernels
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.align.problem import MAX_VIEWS, RigImage, share_pixels
from sphere_nav.photometric.constants import NUM_SAMPLES, TYPICAL_QUANTILE
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Floats, KernelCamera, Level, in_blocks, kernel_motion, rolling
from sphere_nav.photometric.pixels.reference import Selection, choose_pixels

SQUARE = kernels.TA, kernels.TB, kernels.TC, kernels.TD, kernels.DU, kernels.DV  # grey levels, and where between them


@dataclass(frozen=True)
class Sample:
    """Pixels of the images of one body, in its axes: points (N, 3) m, residuals (N,), which view (N,) each is of.

    Views are counted image by image, `MAX_VIEWS` each; range_m (N,) is that from the camera. Gradients (N, 3) by the
    point are those of both images, by_point (N, 2, 3) is where a pixel falls by its point, by_stretch (N,) the
    derivative of the residual by the stretch, current (N,) the grey level of the image, at (N, 2) the place in it,
    -1...1 on both axes.
    """

    view: NDArray[np.int64]
    points: Array
    range_m: Array
    by_point: Array
    of_reference: Array
    of_image: Array
    by_stretch: Array
    current: Array
    residual: Array
    at: Array

    @property
    def image(self) -> NDArray[np.int64]:
        """Which image (N,) each pixel is in."""
        return self.view // MAX_VIEWS

    @property
    def by_pose(self) -> Array:
        """Derivative (N, 6) of the residual by xi in T_world_body exp(xi)."""
        return np.hstack([-self.of_image, np.cross(self.of_image, self.points)])

    def __len__(self) -> int:
        return len(self.residual)

    def where(self, chosen: NDArray[np.bool_]) -> Sample:
        """Return some of the pixels, chosen (N,)."""
        return Sample(*(getattr(self, part.name)[chosen] for part in fields(self)))

    def of_views(self, least: int) -> Sample:
        """Return the pixels of views that have so many at least."""
        return self.where(np.bincount(self.view)[self.view] >= least)


Sampler = Callable[[SE3], Sample]  # gives the pixels at another T_world_body


def cosines(sample: Sample) -> tuple[Array, Array]:
    """Return the cosine (N,) between the gradients of image and reference, and how strong (N,) those of the latter are.

    By direction alone in the image: what covers a part of the view counts by its share, not by its contrast.
    """
    in_reference, in_image = (
        np.sqrt(np.einsum("ni,ni->n", rows, rows)) for rows in (sample.of_reference, sample.of_image)
    )
    product = np.einsum("ni,ni->n", sample.of_reference, sample.of_image)
    return product / np.maximum(in_reference * in_image, TINY), sample.range_m * in_reference


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


def cosines_by_cell(sample: Sample, cells: tuple[int, int], least: int, num_images: int = 1) -> CellCosines:
    """Return the cosines by cells (columns, rows) of so many images, or more; known are those of `least` pixels."""
    cell, (cosine, weight) = cell_of(sample, cells), cosines(sample)
    values = np.stack([weight, weight * cosine, np.ones(len(cell))], axis=-1)
    total, agreeing, count = sum_by_cell(cell, values, num_images * math.prod(cells)).T
    known = (count >= least) & (total > 0.0)
    return CellCosines(cell, cosine, weight, total, agreeing / np.maximum(total, TINY), known)


def cell_of(sample: Sample, cells: tuple[int, int]) -> NDArray[np.int64]:
    """Return in which cell (columns, rows) of its image each pixel (N,) is: image by image, row by row."""
    column, row = np.clip((0.5 * (sample.at + 1.0) * cells).astype(np.int64), 0, np.array(cells) - 1).T
    return (sample.image * cells[1] + row) * cells[0] + column


def sum_by_cell(cell: NDArray[np.int64], values: Array, num_cells: int = 0) -> Array:
    """Return the sum (cells, ...) of values (N, ...) in each cell, of so many cells at least."""
    shape = values.shape[1:]
    sums = [np.bincount(cell, one, num_cells) for one in values.reshape(len(cell), math.prod(shape)).T]
    return np.asarray(np.stack(sums, axis=-1).reshape(-1, *shape), np.float64)


def sample_images(
    images: Sequence[RigImage],
    T_world_body: SE3,
    light: Array,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
) -> Sample:
    """Return pixels of the images of one body; light (views of all, 2) are the gains and biases of their views."""
    first, share, parts = 0, share_pixels(params, len(images)), []
    for index, image in enumerate(images):
        own, first = light[first : first + len(image.views)], first + len(image.views)
        part = sample_views(image, image.pose(T_world_body), own, share, image.motion(motion))
        parts.append(replace(part, view=MAX_VIEWS * index + part.view))
    return Sample(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Sample)))


def sample_views(
    image: RigImage, T_world_camera: SE3, light: Array, params: RegistrationParams, motion: FrameMotion | None
) -> Sample:
    """Return some pixels of each view of an image, warped into it; light (views, 2) are their gains and biases."""
    level, T_camera_world = image.level(params.pyramid.finest), T_world_camera.inverse()
    camera = level.kernel_camera if motion is None else rolling(level.camera, motion.twist(T_world_camera))
    number, tables, rotations = len(image.views), list[Floats](), list[Array]()
    for view in image.views:
        T = T_camera_world @ view.T_world_reference
        pixels = view.reference.level_like(level.camera)
        selection = choose_pixels(pixels, T, level.camera, params.max_pixels // number)
        tables.append(locate_pixels(thin_blocks(selection, NUM_SAMPLES // number), T, camera, level))
        rotations.append((image.mount @ T).rotation)
    of_view = np.repeat(np.arange(number), [len(one) for one in tables])
    return interpolate(np.concatenate(tables), of_view, np.stack(rotations), light, level, image.mount)


def thin_blocks(selection: Selection, number: int) -> Floats:
    """Return blocks of about so many of the chosen pixels, evenly taken."""
    step = max(1, selection.num_pixels // number)
    some = selection.blocks.reshape(selection.blocks.size // BLOCK, BLOCK // SIDE, SIDE)[:, :, ::step]
    rows = some.transpose(1, 0, 2).reshape(BLOCK // SIDE, some.shape[0] * some.shape[2])
    return in_blocks(rows)


def locate_pixels(blocks: Floats, T: SE3, camera: KernelCamera, level: Level) -> Floats:
    """Return rows of blocks, then of the scratch, of the pixels (N, ROWS) that are seen; T is reference -> camera."""
    scratch = np.zeros((blocks.size // BLOCK, kernels.SCRATCH), np.float32)
    kernels.locate_all(blocks, kernel_motion(T.matrix), camera, level.samples, scratch)
    both = np.concatenate([blocks.reshape(len(scratch), BLOCK), scratch], axis=1)
    table = both.reshape(len(scratch), both.shape[1] // SIDE, SIDE).swapaxes(1, 2)
    return table[scratch[:, kernels.SEEN : kernels.SEEN + SIDE] > 0.0]


def interpolate(
    table: Floats, view: NDArray[np.int64], rotations: Array, light: Array, level: Level, T_body_camera: SE3
) -> Sample:
    """Return pixels of the table of an image; rotations (views, 3, 3) are those of reference -> body."""
    values, (gain, bias) = table.T.astype(np.float64), light[view].T
    pixel, found = values[: BLOCK // SIDE], values[BLOCK // SIDE :]
    upper_left, upper_right, lower_left, lower_right, right, down = (found[first // SIDE] for first in SQUARE)
    top = upper_left + right * (upper_right - upper_left)
    bottom = lower_left + right * (lower_right - lower_left)
    by_u = gain * ((1.0 - down) * (upper_right - upper_left) + down * (lower_right - lower_left))
    by_v, current = gain * (bottom - top), top + down * (bottom - top)
    center = 0.5 * (np.array([level.camera.width, level.camera.height]) - 1.0)
    offset = found[[kernels.U // SIDE, kernels.V // SIDE]].T - center
    points = found[kernels.X // SIDE : kernels.Z // SIDE + 1].T
    by_point = found[kernels.J0 // SIDE : kernels.J5 // SIDE + 1].T.reshape(-1, 2, 3) @ T_body_camera.rotation.T
    return Sample(
        view=view,
        points=T_body_camera.apply(points),
        range_m=np.linalg.norm(points, axis=1),
        by_point=by_point,
        of_reference=np.einsum("nij,jn->ni", rotations[view], pixel[kernels.BX // SIDE : kernels.BZ // SIDE + 1]),
        of_image=by_u[:, None] * by_point[:, 0] + by_v[:, None] * by_point[:, 1],
        by_stretch=by_u * offset[:, 0] + by_v * offset[:, 1],
        current=current,
        residual=gain * current + bias - pixel[kernels.GRAY // SIDE],
        at=offset / center,
    )
