"""The pixels of the map that an image of a drive is compared with, level by level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photometric import Pyramid, View
from photometric.iteration.kernels import BLOCK, SIDE
from photometric.selection import select
from rig_calibration.drive_image import DriveImage, LevelData
from sphere_geometry import SE3

NUM_PIXELS = 6_000  # of each level, the most salient
NUM_LEVELS = 3
ROWS_OF_POINT, ROW_OF_GREY = slice(0, 3), 3  # of a block (photometric/iteration/kernels.py)


def collect(pyramid: Pyramid, view: View, T_map_camera: SE3, velocity: NDArray[np.float64]) -> DriveImage:
    """Return an image with the most salient pixels of a reference that it should show from a pose."""
    T_camera_reference = T_map_camera.inverse() @ view.T_world_reference
    levels = []
    for level in pyramid.levels[:NUM_LEVELS]:
        chosen = select(view.reference.level_like(level.camera), T_camera_reference, level.camera, NUM_PIXELS)
        blocks = chosen.blocks.reshape(-1, BLOCK // SIDE, SIDE).transpose(1, 0, 2).reshape(BLOCK // SIDE, -1)
        blocks = blocks[:, : chosen.num_pixels].astype(np.float64)
        points_map = view.T_world_reference.apply(blocks[ROWS_OF_POINT].T)
        levels.append(LevelData(level.image.astype(np.float32), points_map, blocks[ROW_OF_GREY]))
    return DriveImage(tuple(levels), T_map_camera, velocity)
