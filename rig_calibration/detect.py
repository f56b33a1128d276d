"""Corners of a board in a grey image: chessboards by two detectors, ChArUco boards by their markers."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rig_calibration.board import Board
from rig_calibration.views import Array, Indices

Grey = NDArray[np.uint8]

SECTOR_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
QUAD_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
REFINEMENT = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
MAX_HALF_WINDOW = 7
MIN_SPACING_PX = 4.0  # below it neighbours blur into each other


def detect(grey: Grey, board: Board) -> tuple[Indices, Array] | None:
    """Return numbers (n,) of the corners of a board and their pixels (n, 2), or None where it is not seen."""
    return _charuco(grey, board) if board.kind == "charuco" else _chessboard(grey, board)


def _chessboard(grey: Grey, board: Board) -> tuple[Indices, Array] | None:
    """Try the detector by quadrangles, which stands strong distortion, then the one by sectors, which stands blur."""
    for finder in (_by_quads, _by_sectors):
        corners = finder(grey, board)
        if corners is None:
            continue
        corners = canonical(grey, board, corners)
        spacing = _spacing(corners, board)
        if spacing >= MIN_SPACING_PX and _is_grid(corners, board):
            return np.arange(board.num_corners), _refined(grey, corners, spacing)
    return None


def _by_quads(grey: Grey, board: Board) -> Array | None:
    found, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=QUAD_FLAGS)
    return _as_corners(corners, board) if found else None


def _by_sectors(grey: Grey, board: Board) -> Array | None:
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=SECTOR_FLAGS)
    return _as_corners(corners, board) if found else None


def _as_corners(corners: Any, board: Board) -> Array | None:
    """Return (N, 2), or None for a detector's answer of another size."""
    found = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return found if len(found) == board.num_corners else None


def canonical(grey: Grey, board: Board, corners: Array) -> Array:
    """Number corners (N, 2) alike in all images: x to the right of y as on the board, a dark square at the first.

    What still looks alike after that are the `turns` of the board.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:  # seen in a mirror: numbered the wrong way
        grid = grid[:, ::-1]
    if _contrast(grey, grid) < 0:
        if (board.columns + board.rows) % 2:
            grid = grid[::-1, ::-1]
        elif board.columns == board.rows and board.columns % 2:
            grid = np.rot90(grid)
    return np.ascontiguousarray(grid).reshape(-1, 2)


def _contrast(grey: Grey, grid: Array) -> float:
    """Return how much brighter the other squares are than those of the colour of the first one."""
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4.0
    levels = cv2.remap(grey, centres.astype(np.float32), None, cv2.INTER_LINEAR).astype(np.float64)
    row, column = np.indices(levels.shape)
    return float(np.mean(levels[(row + column) % 2 == 1]) - np.mean(levels[(row + column) % 2 == 0]))


def _spacing(corners: Array, board: Board) -> float:
    """Return the shortest distance of neighbours in pixels."""
    grid = corners.reshape(board.rows, board.columns, 2)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=-1).min()
    return float(min(across, np.linalg.norm(np.diff(grid, axis=0), axis=-1).min()))


def _is_grid(corners: Array, board: Board) -> bool:
    """Whether every corner lies near the middle of its neighbours: through any lens, neighbouring steps are alike."""
    grid = corners.reshape(board.rows, board.columns, 2)
    for axis in (0, 1):
        step = np.diff(grid, axis=axis)
        bend = np.linalg.norm(np.diff(step, axis=axis), axis=-1)
        size = np.linalg.norm(step, axis=-1)
        shorter = np.minimum(*(np.take(size, range(k, size.shape[axis] - 1 + k), axis=axis) for k in (0, 1)))
        if np.any(bend > 0.6 * shorter):
            return False
    return True


def _refined(grey: Grey, corners: Array, spacing: float) -> Array:
    """Return corners (N, 2) to a fraction of a pixel, with windows that no neighbour reaches into."""
    half = int(np.clip(0.4 * spacing, 2, MAX_HALF_WINDOW))
    found = corners.astype(np.float32).reshape(-1, 1, 2).copy()
    cv2.cornerSubPix(grey, found, (half, half), (-1, -1), REFINEMENT)
    refined = found.reshape(-1, 2).astype(np.float64)
    moved = np.linalg.norm(refined - corners, axis=-1)
    return np.where((moved < half)[:, None], refined, corners)


def _charuco(grey: Grey, board: Board) -> tuple[Indices, Array] | None:
    found, numbers, _, _ = _charuco_detector(board).detectBoard(grey)
    if found is None or numbers is None or len(numbers) < 4:
        return None
    corners = np.asarray(found, dtype=np.float64).reshape(-1, 2)
    order = np.asarray(numbers, dtype=np.intp).ravel()
    spacing = _charuco_spacing(order, corners, board)
    return order, _refined(grey, corners, spacing)


def _charuco_spacing(numbers: Indices, corners: Array, board: Board) -> float:
    """Return the shortest distance of corners in pixels, by one square where they are neighbours."""
    places = np.stack(np.divmod(numbers, board.columns), axis=-1)
    between = np.linalg.norm(corners[:, None] - corners, axis=-1)
    squares = np.abs(places[:, None] - places).sum(axis=-1)
    return float(np.min(between[squares > 0] / squares[squares > 0]))


@lru_cache
def _charuco_detector(board: Board) -> Any:
    number = getattr(cv2.aruco, board.dictionary, None)
    if not isinstance(number, int):
        raise ValueError(
            f"board {board.name!r}: dictionary: expected a name such as DICT_4X4_250, found {board.dictionary!r}"
        )
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    available = len(dictionary.bytesList)
    last = board.first_marker + board.num_markers
    if last > available:
        raise ValueError(
            f"board {board.name!r}: dictionary: expected {last} markers for {board.columns}x{board.rows} corners, "
            f"found {available} in {board.dictionary}"
        )
    ids = np.arange(board.first_marker, last)
    pattern = cv2.aruco.CharucoBoard(
        (board.columns + 1, board.rows + 1), board.square_m, board.marker_m, dictionary, ids
    )
    pattern.setLegacyPattern(board.is_legacy)
    return cv2.aruco.CharucoDetector(pattern)
