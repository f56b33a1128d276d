"""The run-time selection s(.) of M15 eq. 16: the most salient pixels of a reference that the camera sees."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photometric import kernels
from photometric.pyramid import Level
from photometric.reference import Reference, ReferenceLevel, Selection, kernel_camera
from photometric.scratch import scratch
from sphere_geometry import SE3

MAX_SHIFT = 0.02  # of the image's width: a selection is used again while the image has moved less than this


def level_like(reference: Reference, level: Level) -> ReferenceLevel:
    """Return the level of the reference whose angular resolution is nearest to the image's."""
    finest = reference.camera.pixels_per_radian
    index = round(math.log2(finest / level.camera.pixels_per_radian))
    return reference.levels[min(max(index, 0), len(reference.levels) - 1)]


def choose(pixels: ReferenceLevel, T_camera_reference: SE3, level: Level, number: int) -> ReferenceLevel:
    """Return `select`, or the last selection for this camera where it still holds: images of a stream move little."""
    key = (level.camera, number)
    last = pixels.selections.get(key)
    if last is None or _image_shift(last, T_camera_reference, level) > MAX_SHIFT * level.camera.width:
        last = Selection(T_camera_reference, select(pixels, T_camera_reference, level, number))
        pixels.selections[key] = last
    return last.pixels


def select(pixels: ReferenceLevel, T_camera_reference: SE3, level: Level, number: int) -> ReferenceLevel:
    """Return the `number` most salient pixels that project into the image, in scan order."""
    seen = visible(pixels, T_camera_reference, level)
    if np.count_nonzero(seen) <= number:
        return pixels.take(np.flatnonzero(seen))
    return pixels.take(kernels.best_of(seen, pixels.rank, number))


def visible(pixels: ReferenceLevel, T_camera_reference: SE3, level: Level) -> NDArray[np.bool_]:
    """Return which pixels (N,) of a reference project into the image of a level."""
    model, coefficients = kernel_camera(level.camera)
    seen = np.empty(pixels.num_pixels, np.bool_)
    T = np.ascontiguousarray(T_camera_reference.matrix[:3], dtype=np.float32)
    size = (level.camera.width, level.camera.height)
    kernels.find_visible(pixels.points, T, model, coefficients, *size, scratch(), seen)
    return seen


def _image_shift(last: Selection, T_camera_reference: SE3, level: Level) -> float:
    """Return how far the image has moved since a selection, in pixels."""
    distance, angle = last.T_camera_reference.distance(T_camera_reference)
    return float(angle + distance / last.pixels.typical_range) * level.camera.pixels_per_radian
