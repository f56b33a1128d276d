"""How much of an image the references cover."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photometric.pyramid import Pyramid
from photometric.reference import View
from photometric.selection import level_like
from sphere_geometry import SE3, Camera
from sphere_geometry.camera import pixel_grid

CELL = 3  # pixels of the coarsest level: wide enough that a covered cell catches a reference pixel


def image_overlap(pyramid: Pyramid, views: Sequence[View], T_world_camera: SE3) -> float:
    """Return the share (0..1) of the image, in cells of the coarsest level, where some reference has range."""
    level = pyramid.levels[-1]
    cells = _cells_with_rays(level.camera)
    covered = np.zeros_like(cells)
    for view in views:
        points = level_like(view.reference, level).points
        T_camera_reference = T_world_camera.inverse() @ view.T_world_reference
        pixels, visible = level.camera.project(T_camera_reference.apply(points.T))
        u, v = np.round(pixels[visible]).astype(np.int64).T // CELL
        covered[np.clip(v, 0, cells.shape[0] - 1), np.clip(u, 0, cells.shape[1] - 1)] = True
    return float(np.sum(covered & cells)) / max(float(np.sum(cells)), 1.0)


@lru_cache(maxsize=16)
def _cells_with_rays(camera: Camera) -> NDArray[np.bool_]:
    """Return which cells hold a pixel that sees anything; the corners of a fisheye image do not."""
    has_ray = ~np.isnan(camera.unproject(pixel_grid(camera))[..., 0])
    cells = np.zeros((-(-camera.height // CELL), -(-camera.width // CELL)), np.bool_)
    v, u = np.nonzero(has_ray)
    cells[v // CELL, u // CELL] = True
    return cells
