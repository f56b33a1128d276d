"""The run-time selection s(.) of M15 eq. 16: the most salient of the pixels that the camera sees.

Salient by algorithm 1, balanced over the six columns among what is visible: what is best elsewhere says nothing here.
"""

from __future__ import annotations

import math

import numpy as np

from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import empty_to_keep
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.align.projection import kernel_camera, kernel_motion
from sphere_nav.photometric.constants import MAX_SHIFT
from sphere_nav.photometric.pixels import kernels
from sphere_nav.photometric.pixels.reference import ReferenceLevel, Selection


def choose_pixels(pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int) -> Selection:
    """Return `select`, or the last selection for this camera where it still holds: images of a stream move little."""
    if not holds(pixels, T_camera_reference, camera, number):
        renew_selection(pixels, T_camera_reference, camera, number)
    return pixels.selections[camera, number]


def renew_selection(pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int) -> None:
    """Let `choose_pixels` return the selection at another pose."""
    pixels.selections[camera, number] = select(pixels, T_camera_reference, camera, number)


def holds(
    pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int, max_shift: float = MAX_SHIFT
) -> bool:
    """Say whether the image has moved less than a share of its width since the last selection for this camera."""
    last = pixels.selections.get((camera, number))
    return last is not None and _image_shift(last, T_camera_reference, camera) <= max_shift * camera.width


def select(pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int) -> Selection:
    """Return the `number` most salient of the pixels that project into the image, in the order of the reference."""
    squares = pixels.squares.near(T_camera_reference, camera, is_thinned=True)
    T = kernel_motion(T_camera_reference.matrix)
    seen = np.empty(squares.places.size * SIDE, np.int32)
    args = (T, kernel_camera(camera), camera.width, camera.height)
    chosen = seen[: kernels.find_visible(squares.places, squares.pool, *args, seen)]
    if chosen.size > number:
        chosen = kernels.best_of(chosen, squares.keys, number)
    blocks = empty_to_keep(-(-chosen.size // SIDE) * BLOCK, np.float32)
    inverse = kernels.gather(squares.pool, chosen, blocks)
    return Selection(T_camera_reference, blocks, chosen.size, 1.0 / inverse)


def _image_shift(last: Selection, T_camera_reference: SE3, camera: Camera) -> float:
    """Return how far the image has moved since a selection, in pixels: the chord of the turn, and the parallax."""
    off = T_camera_reference.matrix - last.T_camera_reference.matrix
    turn = math.sqrt(0.5 * float(np.vdot(off[:3, :3], off[:3, :3])))
    distance = math.sqrt(float(np.vdot(off[:3, 3], off[:3, 3])))
    return (turn + distance / last.typical_range) * camera.pixels_per_radian
