"""One image of a drive in a map: its residuals and their derivatives by lens, readout, pose and light.

The pixels of the map that an image of a drive is compared with, level by level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from rig_calibration.constants import (
    MIN_PIXELS,
    MIN_SIGMA,
    NUM_LENS_LEVELS,
    NUM_LENS_PIXELS,
    SAME_ROW,
    SMALL,
)
from rig_calibration.drive.drive_lens import Lens
from sphere_nav.estimation.elimination import Part
from sphere_nav.estimation.least_squares import weigh
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Floats
from sphere_nav.geometry.cameras.camera import inside
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling
from sphere_nav.photometric import Pyramid, View
from sphere_nav.photometric.align.iteration.kernels import BLOCK, GRAY, SIDE
from sphere_nav.photometric.pixels.reference import select

ROW_OF_GRAY = GRAY // SIDE  # of a block, behind those of the point


def collect(pyramid: Pyramid, view: View, T_map_camera: SE3, velocity: Array) -> DriveImage:
    """Return an image with the most salient pixels of a reference that it should show from a pose."""
    T_camera_reference = T_map_camera.inverse() @ view.T_world_reference
    levels = []
    for level in pyramid.levels[:NUM_LENS_LEVELS]:
        chosen = select(view.reference.level_like(level.camera), T_camera_reference, level.camera, NUM_LENS_PIXELS)
        blocks = chosen.blocks.reshape(-1, BLOCK // SIDE, SIDE).transpose(1, 0, 2).reshape(BLOCK // SIDE, -1)
        blocks = blocks[:, : chosen.num_pixels].astype(np.float64)
        points_map = view.T_world_reference.apply(blocks[:ROW_OF_GRAY].T)
        levels.append(LevelData(level.image.astype(np.float32), points_map, blocks[ROW_OF_GRAY]))
    return DriveImage(tuple(levels), T_map_camera, velocity, _axes_of_lens(view))


def _axes_of_lens(view: View) -> SE3 | None:
    """Return T_map_optical, z along the middle of a partial sphere: about the axis of its lens; None of a whole one."""
    camera = view.reference.camera
    if camera.is_whole:
        return None
    z = camera.unproject(np.array([(camera.width - 1) / 2.0, (camera.height - 1) / 2.0]))
    x = np.cross(z, (0.0, 0.0, 1.0))  # to the right: spheres have body axes
    x /= max(float(np.linalg.norm(x)), 1e-9)
    return view.T_world_reference @ SE3.from_parts(np.stack([x, np.cross(z, x), z], axis=1), np.zeros(3))


@dataclass(frozen=True, eq=False)
class LevelData:
    """One level: image (H, W) float32, points (N, 3) m of the map that it should show, their grey levels (N,)."""

    image: Floats
    points_map: Array
    gray: Array


@dataclass(frozen=True, eq=False)
class DriveImage:
    """An image from full size to coarse, where it was taken, and the camera's velocity (6,) (v, omega) per second.

    T_map_optical are the axes of the lens that made the partial sphere it is compared with; None for a whole sphere.
    """

    levels: tuple[LevelData, ...]
    T_map_camera: SE3
    velocity: Array
    T_map_optical: SE3 | None = None


@dataclass(frozen=True)
class ImageState:
    """What is estimated of one image: T_map_camera, and how its grey levels become the map's."""

    pose: SE3
    gain: float = 1.0
    bias: float = 0.0

    def moved(self, step: Array) -> ImageState:
        """Return the state after a step (8,)."""
        return ImageState(self.pose @ SE3.exp(step[:6]), self.gain + step[6], self.bias + step[7])


def weigh_part(residual: Array, J: Array) -> Part:
    """Return the robust normal equations of residuals (N,) with derivatives (N, columns); too few say nothing."""
    num_columns = J.shape[1]
    if len(residual) < MIN_PIXELS:
        return Part(np.zeros((num_columns, num_columns)), np.zeros(num_columns), 0, MIN_SIGMA)
    weight, sigma = weigh(residual, MIN_SIGMA)
    weighted = J * weight[:, None]
    return Part(weighted.T @ J, weighted.T @ residual, len(residual), sigma)


def differentiate(image: DriveImage, state: ImageState, lens: Lens, level: int) -> tuple[Array, Array]:
    """Return the residuals (N,) of the pixels in view and their derivative (N, P + 8), of pixels by differences."""
    data, num_lens = image.levels[level], len(lens.names)
    pixels = _pixels(image, state.pose, lens, level)
    seen = inside(pixels, lens.level(level))
    current, gradient = sample_with_gradient(data.image, pixels[seen])
    steps = np.diag(SMALL * np.append(lens.prior_sigma, np.ones(6)))
    moved = [
        _pixels(image, state.pose @ SE3.exp(step[num_lens:]), lens.moved(step[:num_lens]), level)[seen]
        for step in steps
    ]
    by_pixel = state.gain * gradient / np.diag(steps)[:, None, None]
    J = np.sum((np.stack(moved) - pixels[seen]) * by_pixel, axis=-1)
    residual = state.gain * current + state.bias - data.gray[seen]
    return residual, np.column_stack([J.T, current, np.ones(len(current))])


def _pixels(image: DriveImage, T_map_camera: SE3, lens: Lens, level: int) -> Array:
    """Return where the points of a level are seen (N, 2)."""
    points = image.levels[level].points_map
    if image.T_map_optical is not None:
        corrected = lens.correct_map(image.T_map_optical.inverse().apply(points))
        points = image.T_map_optical.apply(corrected)
    points = T_map_camera.inverse().apply(points)
    return project_rolling(lens.level(level), points, lens.readout * image.velocity, SAME_ROW)[0]


def sample_with_gradient(image: Floats, pixels: Array) -> tuple[Array, Array]:
    """Return grey levels (N,) and their gradient (N, 2) at pixels (N, 2), bilinear."""

    def at(du: float, dv: float) -> Array:  # cv2.remap knows no finer steps than 1/32 px
        places = pixels[:, ::-1].T + np.array([[dv], [du]])
        return np.asarray(map_coordinates(image, places, np.float64, order=1, mode="nearest"))

    gradient = np.stack([at(0.5, 0.0) - at(-0.5, 0.0), at(0.0, 0.5) - at(0.0, -0.5)], axis=-1)
    return at(0.0, 0.0), gradient
