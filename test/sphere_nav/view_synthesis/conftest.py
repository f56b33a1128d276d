"""A room with a board that hides a part of the wall behind it."""

from __future__ import annotations

import numpy as np
import pytest

from worlds.room import Room

BOARD_X, BOARD_HALF = 2.0, (0.5, 0.6)  # m ahead; half its width and height


class RoomWithBoard(Room):
    """The board stands across the x axis; its texture is darker, so that it is told from the wall."""

    def cast(self, origin, rays):
        gray, range_m = super().cast(origin, rays)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_board = (BOARD_X - origin[..., 0]) / rays[..., 0]
        points = origin + rays * to_board[..., None]
        on_board = (np.abs(points[..., 1]) < BOARD_HALF[0]) & (np.abs(points[..., 2]) < BOARD_HALF[1])
        is_hit = on_board & (to_board > 0) & (to_board < range_m)
        return np.where(is_hit, 0.3 * self.gray(points), gray), np.where(is_hit, to_board, range_m)


@pytest.fixture(scope="session")
def room():
    return Room()


@pytest.fixture(scope="session")
def room_with_board():
    return RoomWithBoard()
