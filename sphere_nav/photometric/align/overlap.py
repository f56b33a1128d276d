"""How much of an image the references cover."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric.align.projection import kernel_motion
from sphere_nav.photometric.constants import OVERLAP_CELL
from sphere_nav.photometric.pixels import kernels
from sphere_nav.photometric.pixels.pyramid import Pyramid
from sphere_nav.photometric.pixels.reference import View


def image_overlap(pyramid: Pyramid, views: Sequence[View], T_world_camera: SE3) -> float:
    """Return the share (0..1) of the image, in cells of the coarsest level, where some reference has range."""
    level = pyramid.levels[-1]
    camera = level.camera
    cells = _cells_with_rays(camera)
    covered = np.zeros_like(cells)
    T_camera_world = T_world_camera.inverse()
    image = (level.kernel_camera, camera.width, camera.height, OVERLAP_CELL, covered)
    for view in views:
        pixels = view.reference.level_like(camera)
        T_camera_reference = T_camera_world @ view.T_world_reference
        seen = pixels.squares.near(T_camera_reference, camera)
        kernels.cover(seen.places, seen.pool, kernel_motion(T_camera_reference.matrix), *image)
    return float(np.sum(covered & cells)) / max(float(np.sum(cells)), 1.0)


@lru_cache(maxsize=16)
def _cells_with_rays(camera: Camera) -> NDArray[np.bool_]:
    """Return which cells hold a pixel that sees anything; the corners of a fisheye image do not."""
    has_ray = ~np.isnan(pixel_rays(camera)[..., 0])
    cells = np.zeros((-(-camera.height // OVERLAP_CELL), -(-camera.width // OVERLAP_CELL)), np.bool_)
    v, u = np.nonzero(has_ray)
    cells[v // OVERLAP_CELL, u // OVERLAP_CELL] = True
    return cells
