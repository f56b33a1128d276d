"""How sharp a board is in an image: the width of the edges between its squares, in pixels."""

from __future__ import annotations

import cv2
import numpy as np

from rig_calibration.boards.board import Board
from rig_calibration.boards.views import Indices
from rig_calibration.constants import QUARTILES_APART, SAMPLED_PX2
from sphere_nav.geometry.arrays import Array, Bytes


def edge_width(gray: Bytes, board: Board, corners: Indices, pixels: Array) -> float:
    """Return the standard deviation of the blur of a board's edges in pixels, NaN where a corner is missing.

    By OpenCV: between a quarter and three quarters of the way from dark to bright lie 1.349 standard deviations. The
    larger mean of both axes counts: motion blurs one of them.
    """
    if len(corners) < board.num_corners:
        return float("nan")
    grid, size = pixels[np.argsort(corners)].astype(np.float32)[:, None], (board.columns, board.rows)
    widths = [
        cv2.estimateChessboardSharpness(gray, size, grid, 0.5, is_vertical)[0][0] for is_vertical in (False, True)
    ]
    width = max(widths) / QUARTILES_APART
    return float(np.sqrt(max(width**2 - SAMPLED_PX2, 0.0))) if width < max(gray.shape) else float("nan")
