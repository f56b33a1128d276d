"""The range of an image that has none, by the references it was aligned with: the warped depth of M15 section 5.3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photometric.iteration.kernels import BLOCK, SIDE
from photometric.params import RegistrationParams
from photometric.rig import RigImage
from photometric.selection import choose
from sphere_geometry import SE3


def range_of_view(image: RigImage, T_world_body: SE3, params: RegistrationParams) -> NDArray[np.float32]:
    """Return the range (H, W) in m along the rays of an image at a pose, NaN where no reference tells it.

    It is known at the pixels that an alignment would choose; the nearest point of a pixel counts.
    """
    level = image.pyramid.levels[0]
    camera, T_camera_world = level.camera, image.pose(T_world_body).inverse()
    range_m = np.full((camera.height, camera.width), np.nan, np.float32)
    for view in image.views:
        T_camera_reference = T_camera_world @ view.T_world_reference
        pixels = view.reference.level_like(camera)
        selection = choose(pixels, T_camera_reference, camera, params.max_pixels // len(image.views))
        rows = selection.blocks.reshape(-1, BLOCK // SIDE, SIDE)[:, :3].transpose(1, 0, 2).reshape(3, -1)
        points = T_camera_reference.apply(rows[:, ~np.isnan(rows[2])].T.astype(np.float64))
        uv, is_visible = camera.project(points)
        column, row = np.rint(uv[is_visible]).astype(np.int64).T
        distance = np.linalg.norm(points[is_visible], axis=1).astype(np.float32)
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        column, row, distance = column[inside], row[inside], distance[inside]
        np.fmin.at(range_m, (row, column), np.where(distance < params.far, distance, np.inf))
    return range_m
