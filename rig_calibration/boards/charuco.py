"""Markers and corners of ChArUco boards, by OpenCV 4.7 or later."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from rig_calibration.boards.board import Board
from rig_calibration.boards.views import Indices
from sphere_nav.geometry.arrays import Array, Bytes
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


def find_corners(gray: Bytes, board: Board) -> tuple[Indices, Array]:
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
