"""How sharp a board is in an image: the width of the edges between its squares, in pixels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rig_calibration.boards.board import Board
from rig_calibration.boards.views import Indices
from rig_calibration.constants import EDGE_REACH, EDGE_SAMPLES, QUARTILES_APART
from sphere_nav.geometry.arrays import Array


def edge_width(gray: NDArray[np.uint8], board: Board, corners: Indices, pixels: Array) -> float:
    """Return the standard deviation of the blur of a board's edges in pixels, NaN where none can be measured.

    An edge is cut half way between two neighboring corners, along the board's other axis; its grey levels go from those
    of one square to those of the other. Between a quarter and three quarters of the way lie 1.349 standard deviations.
    The larger median of both axes counts: motion blurs one of them.
    """
    known_corners = np.full((board.num_corners, 2), np.nan)
    known_corners[corners] = pixels
    grid: Array = known_corners.reshape(board.rows, board.columns, 2)
    widths = []
    for one in (grid, grid.swapaxes(0, 1)):
        middle, across = (one[:, 1:] + one[:, :-1]) / 2, np.gradient(one, axis=0)
        across = (across[:, 1:] + across[:, :-1]) / 2
        known = np.isfinite(middle).all(axis=-1) & np.isfinite(across).all(axis=-1)
        along = (one[:, 1:] - one[:, :-1])[known]
        widths.append(_median_width(gray, middle[known], across[known], along))
    return float(np.nanmax(widths)) if np.isfinite(widths).any() else float("nan")


def _median_width(gray: NDArray[np.uint8], middle: Array, across: Array, along: Array) -> float:
    """Return the median standard deviation of edges at (E, 2), cut along vectors (E, 2) to the next corners."""
    if not len(middle):
        return float("nan")
    reach = EDGE_REACH * np.linalg.norm(across, axis=-1)
    steps = np.linspace(-1.0, 1.0, EDGE_SAMPLES)
    places = middle[:, None] + (EDGE_REACH * across)[:, None] * steps[:, None]
    levels = cv2.remap(gray, places.astype(np.float32), None, cv2.INTER_LINEAR).astype(np.float64)
    fifth = EDGE_SAMPLES // 5
    low, high = np.median(levels[:, :fifth], axis=1), np.median(levels[:, -fifth:], axis=1)
    share = (levels - low[:, None]) / np.where(high == low, np.nan, high - low)[:, None]
    quarter, three = (_crossing(share, limit, steps) for limit in (0.25, 0.75))
    sine = np.abs(across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0])  # the cut may be askew to the edge
    sine /= np.linalg.norm(across, axis=-1) * np.linalg.norm(along, axis=-1)
    width = (three - quarter) * reach * sine / QUARTILES_APART
    return float(np.nanmedian(width)) if np.isfinite(width).any() else float("nan")


def _crossing(share: Array, limit: float, steps: Array) -> Array:
    """Return where shares (E, S), which rise from 0 to 1, first reach a limit, between the samples."""
    after = np.argmax(share >= limit, axis=1)
    before, row = np.maximum(after - 1, 0), np.arange(len(share))
    rise = share[row, after] - share[row, before]
    part = np.where(rise > 0, (limit - share[row, before]) / np.where(rise > 0, rise, 1.0), 0.0)
    found: Array = np.where(after > 0, steps[before] + part * (steps[after] - steps[before]), np.nan)
    return found
