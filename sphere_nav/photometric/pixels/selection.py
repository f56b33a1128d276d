"""The run-time selection s(.) of M15 eq. 16: the most salient of the pixels that the camera sees.

Salient by algorithm 1, balanced over the six columns among what is visible: what is best elsewhere says nothing here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import empty_to_keep
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.align.projection import kernel_camera, kernel_motion
from sphere_nav.photometric.constants import LATE_SHIFT, MAX_SHIFT
from sphere_nav.photometric.pixels import kernels
from sphere_nav.photometric.pixels.reference import Reference, ReferenceLevel, Selection


def choose_pixels(pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int) -> Selection:
    """Return `select`, or the last selection for this camera where it still holds: images of a stream move little.

    While another thread selects as many, no image waits for it: one of any number serves that held a moment ago.
    """
    if number in pixels.under_way and not holds(pixels, T_camera_reference, camera, number):
        for (other, _), last in list(pixels.selections.items()):
            if other == camera and _image_shift(last, T_camera_reference, camera) <= LATE_SHIFT * camera.width:
                return last
    if not holds(pixels, T_camera_reference, camera, number):
        pixels.selections[camera, number] = select(pixels, T_camera_reference, camera, number)
    return pixels.selections[camera, number]


def holds(
    pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int, max_shift: float = MAX_SHIFT
) -> bool:
    """Say whether the image has moved less than a share of its width since the last selection for this camera."""
    last = pixels.selections.get((camera, number))
    return last is not None and _image_shift(last, T_camera_reference, camera) <= max_shift * camera.width


def image_speed(pixels: ReferenceLevel, twist: NDArray[np.float64], camera: Camera, number: int) -> float:
    """Return by how many widths a second the image moves at a velocity (6,); 0 before anything was selected for it."""
    last = pixels.selections.get((camera, number))
    known = [last] if last else [one for (other, _), one in list(pixels.selections.items()) if other == camera]
    if not known:
        return 0.0
    turn, way = float(np.linalg.norm(twist[3:])), float(np.linalg.norm(twist[:3]))
    return (turn + way / min(one.typical_range for one in known)) * camera.pixels_per_radian / camera.width


@dataclass(frozen=True)
class Chosen:
    """A selection that no image uses until it is kept."""

    pixels: ReferenceLevel
    camera: Camera
    number: int
    selection: Selection

    def keep(self) -> None:
        """Let `choose_pixels` return it."""
        self.pixels.selections[self.camera, self.number] = self.selection


def select_levels(
    reference: Reference, T_camera_reference: SE3, cameras: Iterable[Camera], number: int
) -> list[Chosen]:
    """Return the selection for the camera of every level of a pyramid."""
    found = []
    for camera in cameras:
        pixels = reference.level_like(camera)
        found.append(Chosen(pixels, camera, number, select(pixels, T_camera_reference, camera, number)))
    return found


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
