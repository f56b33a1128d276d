"""Boards out of files, and what cannot be one."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from rig_calibration.boards.board import Board, check_distinct, parse_size, read_boards

FILE = """\
wall: {size: 8x6, square: 0.03}
door: {kind: charuco, size: 6x4, square: 0.1, marker: 0.075, dictionary: DICT_5X5_100, first_marker: 20, legacy: true}
"""


def test_boards_of_a_file(tmp_path):
    (tmp_path / "boards.yaml").write_text(FILE)
    assert read_boards(tmp_path / "boards.yaml") == (
        Board("wall", 8, 6, 0.03),
        Board("door", 6, 4, 0.1, "charuco", 0.075, "DICT_5X5_100", 20, True),
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: {size: 8x6, square: 1, kind: circles}", "kind: expected one of chessboard, charuco, found 'circles'"),
        ("a: {size: 8x6, square: 25}", "square: expected a length in m, up to 10, found 25"),
        ("a: {size: 2x6, square: 1}", "size: expected at least 3x3 inner corners, found 2x6"),
        ("a: {size: 8x6, square: 1, kind: charuco, marker: 1}", r"marker: expected between 0 and the square \(1.0 m\)"),
    ],
)
def test_what_is_no_board_is_named(tmp_path, text, said):
    (tmp_path / "boards.yaml").write_text(text)
    with pytest.raises(ValueError, match=said):
        read_boards(tmp_path / "boards.yaml")


def test_corners_are_numbered_row_by_row_in_meters():
    board = Board("b", 4, 3, 0.5)
    assert (board.num_corners, board.num_markers) == (12, 10)
    np.testing.assert_allclose(board.points[[0, 3, 4, 11]], [[0, 0, 0], [1.5, 0, 0], [0, 0.5, 0], [1.5, 1.0, 0]])
    assert parse_size("4X3") == parse_size("4×3") == parse_size("4 x 3") == (4, 3)


def charuco(name, first, dictionary="DICT_4X4_250"):
    return Board(name, 6, 4, 0.1, "charuco", 0.075, dictionary, first)


@pytest.mark.parametrize(
    ("first", "second", "is_distinct"),
    [
        (charuco("a", 0), charuco("b", 17), True),  # of 17 markers each
        (charuco("a", 0), charuco("b", 16), False),
        (charuco("a", 0), charuco("b", 0, "DICT_5X5_100"), True),
        (charuco("a", 0), Board("b", 6, 4, 0.1), True),
        (Board("a", 6, 4, 0.1), Board("b", 4, 6, 0.2), False),
    ],
)
def test_boards_are_told_apart_by_size_or_markers(first, second, is_distinct):
    with nullcontext() if is_distinct else pytest.raises(ValueError, match="boards 'a' and 'b' look alike"):
        check_distinct((first, second))
