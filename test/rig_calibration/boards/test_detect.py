"""The blur of a board's edges comes back in pixels, whatever the size of the squares."""

import cv2
import numpy as np
import pytest

from rig_calibration.boards.board import Board
from rig_calibration.boards.detect import edge_width

BOARD = Board("board", 6, 5, 0.1)


def drawn(side, blur):
    row, column = np.indices((BOARD.rows + 1, BOARD.columns + 1))
    image = np.where((row + column) % 2, 200.0, 40.0).repeat(side, 0).repeat(side, 1)
    if np.any(blur):
        image = cv2.GaussianBlur(image, (0, 0), sigmaX=blur[0], sigmaY=blur[1])
    noisy = image + np.random.default_rng(0).normal(0.0, 2.0, image.shape)
    corners = side * (BOARD.points[:, :2] / BOARD.square_m + 1.0) - 0.5
    return np.clip(noisy, 0, 255).astype(np.uint8), corners


@pytest.mark.parametrize("side", [20, 60])
@pytest.mark.parametrize("blur", [1.0, 2.5])
def test_blur_is_measured_in_pixels_at_any_size_of_squares(side, blur):
    image, corners = drawn(side, (blur, blur))
    assert edge_width(image, BOARD, np.arange(BOARD.num_corners), corners) == pytest.approx(blur, rel=0.15, abs=0.1)


def test_motion_blurs_one_direction_and_the_worse_one_counts():
    image, corners = drawn(40, (0.5, 3.0))
    assert edge_width(image, BOARD, np.arange(BOARD.num_corners), corners) == pytest.approx(3.0, rel=0.15)
    image, corners = drawn(20, (1.0, 1.0))
    assert np.isnan(edge_width(image, BOARD, np.arange(BOARD.num_corners - 1), corners[:-1]))
