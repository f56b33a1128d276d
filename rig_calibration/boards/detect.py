"""Corners of boards in a grey image, numbered as on the board, to a fraction of a pixel; how sharp boards are.

Those of ChArUco boards by OpenCV 4.7 or later.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import cv2
import numpy as np

from rig_calibration.boards.board import Board
from rig_calibration.boards.views import Indices
from rig_calibration.constants import (
    AROUND,
    BLUR_PX,
    HALF_WINDOW,
    HALVED_FROM,
    MIN_CORNERS,
    MIN_SPACING_PX,
    REFINEMENT,
    SAMPLED_PX2,
)
from sphere_nav.estimation.kernels import SIGMA_OF_MAD
from sphere_nav.geometry.arrays import Array, Bytes, Flags
from sphere_nav.geometry.files.untrusted import told_at

SECTOR_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
SWEEP_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
QUAD_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE


def detect_all(gray: Bytes, boards: Sequence[Board]) -> dict[str, tuple[Indices, Array]]:
    """Return numbers (n,) and pixels (n, 2) of the corners of each board that is seen, by its name.

    A single chessboard is searched thoroughly; among several most are out of sight, and that would take minutes.
    """
    chessboards = [board for board in boards if board.kind == "chessboard"]
    found = {}
    for board, candidates in chessboard_candidates(gray, chessboards):
        seen = _number(gray, board, candidates)
        if seen is not None:
            found[board.name] = seen
    return found | _charuco_boards(gray, [board for board in boards if board.kind == "charuco"])


# --- chessboards, by the two detectors of OpenCV
def chessboard_candidates(gray: Bytes, boards: Sequence[Board]) -> Iterator[tuple[Board, Iterator[Array]]]:
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


def _number(gray: Bytes, board: Board, candidates: Iterable[Array]) -> tuple[Indices, Array] | None:
    """Return the first candidate that looks like a board, numbered as on the board, to a fraction of a pixel."""
    for candidate in candidates:
        if not _is_inside(gray, candidate).all():  # cut by the border: what lies beyond is a guess of the detector
            continue
        corners = canonical(gray, board, candidate)
        spacing = _spacing(corners, board)
        if spacing >= MIN_SPACING_PX and _is_grid(corners, board):
            half = int(np.clip(0.4 * spacing, *HALF_WINDOW))
            return np.arange(board.num_corners), _refine(gray, corners, half)
    return None


def _is_inside(gray: Bytes, corners: Array) -> Flags:
    """Return which corners (N, 2) lie in the image."""
    return np.all((corners >= 0) & (corners <= (gray.shape[1] - 1, gray.shape[0] - 1)), axis=-1)


def canonical(gray: Bytes, board: Board, corners: Array) -> Array:
    """Number corners (N, 2) alike in all images: x to the right of y as on the board, a dark square at the first.

    What still looks alike after that are the `turns` of the board.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:  # seen in a mirror: numbered the wrong way
        grid = grid[:, ::-1]
    if _contrast(gray, grid) < 0:
        if (board.columns + board.rows) % 2:
            grid = grid[::-1, ::-1]
        elif board.columns == board.rows and board.columns % 2:
            grid = np.rot90(grid)
    return np.ascontiguousarray(grid).reshape(-1, 2)


def _contrast(gray: Bytes, grid: Array) -> float:
    """Return how much brighter the other squares are than those of the colour of the first one."""
    centers = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4.0
    levels = cv2.remap(gray, centers.astype(np.float32), None, cv2.INTER_LINEAR).astype(np.float64)
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


def _refine(gray: Bytes, corners: Array, half: int) -> Array:
    """Return corners (N, 2) to a fraction of a pixel, with windows of 2 * half + 1 pixels that hold no other edge."""
    found = corners.astype(np.float32).reshape(-1, 1, 2).copy()
    cv2.cornerSubPix(gray, found, (half, half), (-1, -1), REFINEMENT)
    refined = found.reshape(-1, 2).astype(np.float64)
    moved = np.linalg.norm(refined - corners, axis=-1)
    return np.where((moved < half)[:, None], refined, corners)


# --- ChArUco boards
def check_markers(board: Board) -> None:
    """Raise ValueError where OpenCV is too old, has no such dictionary, or too few markers in it for the board."""
    if not hasattr(cv2.aruco, "CharucoDetector"):
        raise ValueError(f"board {board.name!r}: charuco: expected OpenCV 4.7 or later, found {cv2.__version__}")
    with told_at(f"board {board.name!r}"):
        available = len(_dictionary(board.dictionary).bytesList)
    last = board.first_marker + board.num_markers
    if last > available:
        raise ValueError(
            f"board {board.name!r}: dictionary: expected {last} markers for {board.columns}x{board.rows} corners, "
            f"found {available} in {board.dictionary}"
        )


def _charuco_boards(gray: Bytes, boards: Sequence[Board]) -> dict[str, tuple[Indices, Array]]:
    found = {}
    for board in boards:
        check_markers(board)
        numbers, corners = _find_markers(gray, board)
        is_inside = _is_inside(gray, corners)
        numbers, corners = numbers[is_inside], corners[is_inside]
        if len(numbers) >= MIN_CORNERS:
            gap = 0.5 * (1.0 - board.marker_m / board.square_m) * _charuco_spacing(numbers, corners, board)
            half = int(np.clip(gap + BLUR_PX, *HALF_WINDOW))
            found[board.name] = numbers, _refine(gray, corners, half)
    return found


def _find_markers(gray: Bytes, board: Board) -> tuple[Indices, Array]:
    """Return numbers (n,) and pixels (n, 2) of the corners of a board that an image (H, W) shows once."""
    numbers = np.arange(board.first_marker, board.first_marker + board.num_markers)
    squares, lengths = (board.columns + 1, board.rows + 1), (board.square_m, board.marker_m)
    pattern = cv2.aruco.CharucoBoard(squares, *lengths, _dictionary(board.dictionary), numbers)
    pattern.setLegacyPattern(board.is_legacy)
    corners, found, _, markers = cv2.aruco.CharucoDetector(pattern).detectBoard(gray)
    own = np.array([] if markers is None else markers[np.isin(markers, numbers)])
    if corners is None or found is None or len(np.unique(own)) < len(own):  # a marker twice: the board is, too
        return np.zeros(0, np.intp), np.zeros((0, 2))
    return np.asarray(found, dtype=np.intp).ravel(), np.asarray(corners, dtype=np.float64).reshape(-1, 2)


def _dictionary(name: str) -> Any:
    number = getattr(cv2.aruco, name, None)
    if not isinstance(number, int) or not name.startswith("DICT_"):
        raise ValueError(f"dictionary: expected a name such as DICT_4X4_250, found {name!r}")
    return cv2.aruco.getPredefinedDictionary(number)


def _charuco_spacing(numbers: Indices, corners: Array, board: Board) -> float:
    """Return the shortest distance of corners in pixels, by one square where they are neighbours."""
    places = np.stack(np.divmod(numbers, board.columns), axis=-1)
    between = np.linalg.norm(corners[:, None] - corners, axis=-1)
    squares = np.abs(places[:, None] - places).sum(axis=-1)
    return float(np.min(between[squares > 0] / squares[squares > 0]))


# --- blur
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
    width = 0.5 * SIGMA_OF_MAD * max(widths)
    return float(np.sqrt(max(width**2 - SAMPLED_PX2, 0.0))) if width < max(gray.shape) else float("nan")
