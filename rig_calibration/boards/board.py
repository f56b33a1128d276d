"""Boards: chessboards and ChArUco boards, their corners in metres, and the turns that leave a chessboard as it was."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import (
    MAX_DIGITS,
    MAX_FILE_BYTES,
    load_yaml,
    mapping,
    printable,
    read_as,
    read_text,
    short,
    told_at,
)

MAX_CORNERS = 1000  # in a row of a board
MAX_SQUARE = 10.0  # m; more are millimetres
KINDS = ("chessboard", "charuco")


@dataclass(frozen=True)
class Board:
    """A flat board. Its frame has x along a row of corners, y down the rows and z into the board.

    `columns` and `rows` count inner corners, which are numbered row by row. `dictionary`, `first_marker`, `marker_m`
    and `is_legacy` (patterns of OpenCV before 4.6) describe ChArUco boards.
    """

    name: str
    columns: int
    rows: int
    square_m: float
    kind: str = "chessboard"
    marker_m: float = 0.0
    dictionary: str = "DICT_4X4_250"
    first_marker: int = 0
    is_legacy: bool = False

    def __post_init__(self) -> None:
        marker, square = self.marker_m, self.square_m
        checks = (
            (self.kind in KINDS, f"kind: expected one of {', '.join(KINDS)}, found {self.kind!r}"),
            (
                min(self.columns, self.rows) >= 3,
                f"size: expected at least 3x3 inner corners, found {self.columns}x{self.rows}",
            ),
            (0 < square <= MAX_SQUARE, f"square: expected a length in m, up to {MAX_SQUARE:g}, found {square}"),
            (
                self.kind != "charuco" or 0 < marker < square,
                f"marker: expected between 0 and the square ({square} m), found {marker}",
            ),
        )
        for is_good, text in checks:
            if not is_good:
                raise ValueError(f"board {self.name!r}: {text}")

    @property
    def num_corners(self) -> int:
        """Number of inner corners."""
        return self.columns * self.rows

    @property
    def num_markers(self) -> int:
        """Number of markers of a ChArUco board."""
        return (self.columns + 1) * (self.rows + 1) // 2

    @cached_property
    def points(self) -> Array:
        """Corners (columns * rows, 3) in the board frame, in metres."""
        row, column = np.divmod(np.arange(self.num_corners), self.columns)
        return self.square_m * np.stack([column, row, np.zeros_like(row)], axis=-1).astype(np.float64)

    @cached_property
    def turns(self) -> NDArray[np.intp]:
        """Renumberings (K, N) of the corners that look the same: only the given one (K = 1) for most boards.

        A chessboard with an even sum of columns and rows looks the same upside down, one with even and equal numbers
        also after a quarter turn.
        """
        grid = np.arange(self.num_corners).reshape(self.rows, self.columns)
        if self.kind == "charuco" or (self.columns + self.rows) % 2:
            steps: tuple[int, ...] = (0,)
        elif self.columns == self.rows and self.columns % 2 == 0:
            steps = (0, 1, 2, 3)
        else:
            steps = (0, 2)
        return np.stack([np.rot90(grid, step).ravel() for step in steps])


def parse_size(text: str) -> tuple[int, int]:
    """Return columns and rows of '8x6'."""
    words = text.lower().replace("×", "x").split("x")
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise ValueError(f"board: expected COLUMNSxROWS of inner corners such as 8x6, found {short(text)}")
    columns, rows = (int(word[:MAX_DIGITS]) for word in words)
    if max(columns, rows) > MAX_CORNERS:
        raise ValueError(f"board: expected up to {MAX_CORNERS} inner corners in a row, found {short(text)}")
    return columns, rows


def read_boards(path: Path) -> tuple[Board, ...]:
    """Read several boards: a mapping of names to kind, size, square and, for ChArUco, marker, dictionary, ..."""
    content = load_yaml(path, read_text(path, "file of boards", MAX_FILE_BYTES))
    if not isinstance(content, dict) or not content:
        raise ValueError(f"{path}: expected a mapping of board names, found {type(content).__name__}")
    names = {name: printable(str(name))[:60] for name in content}
    boards = tuple(_board(f"{path}: {names[name]}", str(name), entry) for name, entry in content.items())
    check_distinct(boards)
    return boards


def check_distinct(boards: tuple[Board, ...]) -> None:
    """Raise ValueError where two boards would look alike to a camera."""
    for first, second in combinations(boards, 2):
        if _look_alike(first, second):
            raise ValueError(
                f"boards {first.name!r} and {second.name!r} look alike: expected chessboards of different size, "
                "or ChArUco boards with markers of their own (first_marker, dictionary)"
            )


def _look_alike(first: Board, second: Board) -> bool:
    if first.kind != second.kind:
        return False
    if first.kind == "chessboard":
        return {first.columns, first.rows} == {second.columns, second.rows}
    low, high = sorted((first, second), key=lambda board: board.first_marker)
    return first.dictionary == second.dictionary and low.first_marker + low.num_markers > high.first_marker


@dataclass(frozen=True)
class _Entry:
    size: str
    square: float
    kind: str = "chessboard"
    marker: float = 0.0
    dictionary: str = "DICT_4X4_250"
    first_marker: int = 0
    legacy: bool = False


def _board(place: str, name: str, entry: Any) -> Board:
    known = [field.name for field in fields(_Entry)]
    found: _Entry = read_as(_Entry, mapping(entry, place, known, known[2:]), place)
    with told_at(place):
        (columns, rows), *others = parse_size(found.size), *list(vars(found).values())[1:]
        return Board(name, columns, rows, *others)
