"""Where chessboards may be in an image, by the two detectors of OpenCV."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np

from rig_calibration.boards.board import Board
from rig_calibration.constants import AROUND, HALVED_FROM
from sphere_nav.geometry.arrays import Array, Bytes

SECTOR_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
SWEEP_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
QUAD_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE


def candidates(gray: Bytes, boards: Sequence[Board]) -> Iterator[tuple[Board, Iterator[Array]]]:
    """Yield each board with what may be its corners (N, 2), row by row or column by column, best guess first."""
    if len(boards) == 1:
        yield boards[0], _thorough(gray, boards[0])
    elif boards:
        is_halved = min(gray.shape) >= HALVED_FROM
        small = cv2.resize(gray, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) if is_halved else gray
        swept = _sweep(np.asarray(small), boards)
        for board in boards:
            found = _quick(np.asarray(small), board, swept)
            yield board, ((2.0 * corners + 0.5 if is_halved else corners) for corners in found)


def _thorough(gray: Bytes, board: Board) -> Iterator[Array]:
    """Try the detector by quadrangles, which stands strong distortion, then the one by sectors, which stands blur."""
    size = (board.columns, board.rows)
    yield from _as_corners(cv2.findChessboardCorners(gray, size, flags=QUAD_FLAGS), board)
    yield from _as_corners(cv2.findChessboardCornersSB(gray, size, flags=SECTOR_FLAGS), board)


def _quick(gray: Bytes, board: Board, swept: Sequence[Array]) -> Iterator[Array]:
    """Take a swept grid of the size of the board, else look for it by quadrangles."""
    for grid in swept:
        if grid.shape[:2] == (board.rows, board.columns):
            yield grid.reshape(-1, 2)
        elif grid.shape[:2] == (board.columns, board.rows):
            yield grid.swapaxes(0, 1).reshape(-1, 2)
    yield from _as_corners(cv2.findChessboardCorners(gray, (board.columns, board.rows), flags=QUAD_FLAGS), board)


def grid_sizes(gray: Bytes, count: int) -> list[tuple[int, int]]:
    """Return columns and rows of up to `count` whole chessboards of an image, of whatever size."""
    least = Board("any", 3, 3, 1.0)  # the smallest that there is
    swept = _sweep(gray, [least] * count)[:count]
    return [(grid.shape[1], grid.shape[0]) for grid in swept]


def _sweep(gray: Bytes, boards: Sequence[Board]) -> list[Array]:
    """Return all grids (rows, columns, 2) of an image, of whatever size, each wiped out before the next search."""
    image, grids = gray.copy(), []
    least = min(min(board.columns, board.rows) for board in boards)
    for _ in range(len(boards) + 1):
        is_found, corners, kinds = cv2.findChessboardCornersSBWithMeta(image, (least, least), SWEEP_FLAGS)
        if not is_found:
            break
        grid = np.asarray(corners, dtype=np.float64).reshape(*np.asarray(kinds).shape[:2], 2)
        grids.append(grid)
        hull = cv2.convexHull(grid.reshape(-1, 2).astype(np.float32)).reshape(-1, 2)
        middle = hull.mean(axis=0)
        cv2.fillConvexPoly(image, np.rint(middle + AROUND * (hull - middle)).astype(np.int32), 128)
    return grids


def _as_corners(answer: tuple[bool, Any], board: Board) -> Iterator[Array]:
    """Yield (N, 2), nothing for a detector's answer of another size."""
    is_found, corners = answer
    found = np.asarray(corners, dtype=np.float64).reshape(-1, 2) if is_found else np.zeros((0, 2))
    if len(found) == board.num_corners:
        yield found
