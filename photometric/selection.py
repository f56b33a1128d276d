"""The run-time selection s(.) of M15 eq. 16: the most salient pixels of a reference that the camera sees."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photometric import kernels
from photometric.iteration.kernels import BLOCK, SIDE
from photometric.projection import kernel_motion, view_cone
from photometric.pyramid import Level
from photometric.reference import ReferenceLevel, Selection
from sphere_geometry import SE3

MAX_SHIFT = 0.1  # of the image's width: a selection is used again while the image has moved less than this


def choose(pixels: ReferenceLevel, T_camera_reference: SE3, level: Level, number: int) -> Selection:
    """Return `select`, or the last selection for this camera where it still holds: images of a stream move little."""
    key = (level.camera, number)
    last = pixels.selections.get(key)
    if last is None or _image_shift(last, T_camera_reference, level) > MAX_SHIFT * level.camera.width:
        last = pixels.selections[key] = select(pixels, T_camera_reference, level, number)
    return last


def select(pixels: ReferenceLevel, T_camera_reference: SE3, level: Level, number: int) -> Selection:
    """Return the `number` most salient pixels that project into the image, in the order of the reference."""
    chosen = visible(pixels, T_camera_reference, level)
    if chosen.size > number:
        chosen = kernels.best_of(chosen, pixels.rank, number)
    blocks = np.empty(-(-chosen.size // SIDE) * BLOCK, np.float32)
    inverse = kernels.fill_blocks(pixels.points, pixels.intensity, pixels.gradient, chosen, blocks)
    return Selection(T_camera_reference, blocks, chosen.size, 1.0 / inverse)


def visible(pixels: ReferenceLevel, T_camera_reference: SE3, level: Level) -> NDArray[np.int32]:
    """Return the indices of the pixels of a reference that project into the image of a level."""
    camera, T = level.camera, kernel_motion(T_camera_reference.matrix)
    seen = np.empty(pixels.num_pixels, np.int32)
    args = (T, level.kernel_camera, view_cone(camera), camera.width, camera.height)
    return seen[: kernels.find_visible(pixels.points, pixels.bounds, *args, seen)]


def _image_shift(last: Selection, T_camera_reference: SE3, level: Level) -> float:
    """Return how far the image has moved since a selection, in pixels: the chord of the turn, and the parallax."""
    off = T_camera_reference.matrix - last.T_camera_reference.matrix
    turn = math.sqrt(0.5 * float(np.vdot(off[:3, :3], off[:3, :3])))
    distance = math.sqrt(float(np.vdot(off[:3, 3], off[:3, 3])))
    return (turn + distance / last.typical_range) * level.camera.pixels_per_radian
