"""The images of one to n cameras that are fixed to one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, FrameMotion
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric.align.projection import kernel_camera, kernel_motion
from sphere_nav.photometric.constants import OVERLAP_CELL
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.kernels import cover
from sphere_nav.photometric.pixels.pyramid import Level, Pyramid
from sphere_nav.photometric.pixels.reference import View


@dataclass(frozen=True)
class RigImage:
    """The image of one camera of a rig, with the references that it is compared with.

    T_body_camera None: the camera is the body. `name` tells the cameras of a rig apart.
    """

    pyramid: Pyramid
    T_body_camera: SE3 | None = None
    views: tuple[View, ...] = ()
    name: str = ""

    @property
    def mount(self) -> SE3:
        """T_body_camera of any camera."""
        return self.T_body_camera or SE3.identity()

    def level(self, index: int) -> Level:
        """Return a level of the pyramid, the coarsest where it has fewer."""
        return self.pyramid.levels[min(index, len(self.pyramid.levels) - 1)]

    def pose(self, T_world_body: SE3) -> SE3:
        """Return T_world_camera."""
        return T_world_body @ self.mount

    def body(self, T_world_camera: SE3) -> SE3:
        """Return T_world_body."""
        return T_world_camera @ self.mount.inverse()

    def motion(self, motion: FrameMotion | None) -> FrameMotion | None:
        """Return the motion of the camera within the frame by that of the body."""
        return motion and replace(motion, T_world_before=self.pose(motion.T_world_before))


@cache
def share_pixels(params: RegistrationParams, number: int) -> RegistrationParams:
    """Return the parameters of one of so many cameras."""
    return replace(params, max_pixels=max(params.max_pixels // number, 1))


def image_overlap(cameras: Sequence[Camera], views: Sequence[View], T_world_camera: SE3) -> float:
    """Return the share (0..1) of an image where some reference has range, in cells of the coarsest of its levels."""
    camera = cameras[-1]
    cells = _cells_with_rays(camera)
    covered = np.zeros_like(cells)
    T_camera_world = T_world_camera.inverse()
    image = (kernel_camera(camera), camera.width, camera.height, OVERLAP_CELL, covered)
    for view in views:
        pixels = view.reference.level_like(camera)
        T_camera_reference = T_camera_world @ view.T_world_reference
        seen = pixels.squares.near(T_camera_reference, camera)
        cover(seen.places, seen.pool, kernel_motion(T_camera_reference.matrix), *image)
    return float(np.sum(covered & cells)) / max(float(np.sum(cells)), 1.0)


@lru_cache(maxsize=16)
def _cells_with_rays(camera: Camera) -> NDArray[np.bool_]:
    """Return which cells hold a pixel that sees anything; the corners of a fisheye image do not."""
    has_ray = ~np.isnan(pixel_rays(camera)[..., 0])
    cells = np.zeros((-(-camera.height // OVERLAP_CELL), -(-camera.width // OVERLAP_CELL)), np.bool_)
    v, u = np.nonzero(has_ray)
    cells[v // OVERLAP_CELL, u // OVERLAP_CELL] = True
    return cells
