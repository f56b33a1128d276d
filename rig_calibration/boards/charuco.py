"""Markers and corners of ChArUco boards, by OpenCV 4.7 or later."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rig_calibration.boards.board import Board
from rig_calibration.boards.views import Indices
from sphere_nav.geometry.arrays import Array, Bytes, Floats
from sphere_nav.geometry.files.untrusted import told_at


def check(board: Board) -> None:
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


def find_markers(gray: Bytes, dictionary_name: str) -> tuple[NDArray[np.int32], Floats]:
    """Return numbers (M,) and corners (M, 1, 4, 2) of the markers of a dictionary that an image (H, W) shows."""
    corners, numbers, _ = cv2.aruco.ArucoDetector(_dictionary(dictionary_name)).detectMarkers(gray)
    found = np.zeros(0, np.int32) if numbers is None else np.asarray(numbers, np.int32).ravel()
    return found, np.asarray(corners, np.float32).reshape(-1, 1, 4, 2)


def find_corners(gray: Bytes, board: Board, markers: tuple[NDArray[np.int32], Floats]) -> tuple[Indices, Array]:
    """Return numbers (n,) and pixels (n, 2) of the corners of a board whose markers were found."""
    number, _ = markers
    own = (number >= board.first_marker) & (number < board.first_marker + board.num_markers)
    ids, corners = (part[own] for part in markers)
    if len(ids) < 2 or len(np.unique(ids)) < len(ids):  # a marker twice: the board is, too
        return np.zeros(0, np.intp), np.zeros((0, 2))
    found, numbers, _, _ = _detector(board).detectBoard(gray, None, None, list(corners), ids[:, None])
    if found is None or numbers is None:
        return np.zeros(0, np.intp), np.zeros((0, 2))
    return np.asarray(numbers, dtype=np.intp).ravel(), np.asarray(found, dtype=np.float64).reshape(-1, 2)


def _dictionary(name: str) -> Any:
    number = getattr(cv2.aruco, name, None)
    if not isinstance(number, int) or not name.startswith("DICT_"):
        raise ValueError(f"dictionary: expected a name such as DICT_4X4_250, found {name!r}")
    return cv2.aruco.getPredefinedDictionary(number)


def _detector(board: Board) -> Any:
    numbers = np.arange(board.first_marker, board.first_marker + board.num_markers)
    squares = (board.columns + 1, board.rows + 1)
    dictionary = _dictionary(board.dictionary)
    pattern = cv2.aruco.CharucoBoard(squares, board.square_m, board.marker_m, dictionary, numbers)
    pattern.setLegacyPattern(board.is_legacy)
    return cv2.aruco.CharucoDetector(pattern)
