"""How much of the image each of several key spheres covers: a few points of each, one projection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3, Camera

Array = NDArray[np.float64]
COLUMNS, ROWS = 8, 6  # cells of the image; a cell counts as covered where a point falls into it


def coverage(points: Sequence[NDArray[np.floating]], T_camera_sphere: Sequence[SE3], camera: Camera) -> Array:
    """Return the share (N,) of the image's cells that the points (M, 3) of each of N spheres reach."""
    points_camera = [T.apply(one) for T, one in zip(T_camera_sphere, points, strict=True)]
    if not points_camera:
        return np.zeros(0)
    owner = np.repeat(np.arange(len(points)), [one.shape[0] for one in points])
    pixels, is_visible = camera.project(np.concatenate(points_camera))
    u, v = pixels[is_visible].T
    column = np.clip((u + 0.5) * (COLUMNS / camera.width), 0, COLUMNS - 1).astype(np.int64)
    row = np.clip((v + 0.5) * (ROWS / camera.height), 0, ROWS - 1).astype(np.int64)
    cells = np.zeros((len(points), ROWS, COLUMNS), np.bool_)
    cells[owner[is_visible], row, column] = True
    return cells.mean(axis=(1, 2))
