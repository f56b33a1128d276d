import numpy as np
import pytest

from cycab_sim.world.paths import Path, Piece, arc, turn

SNAKE = Path((1.0, 2.0, 0.3), (Piece(5.0), turn(4.0, 90), Piece(3.0), turn(6.0, -45), Piece(2.0)))


def test_an_arc_is_exact_and_can_be_cut_anywhere(rng):
    for curvature in (0.0, 1e-9, 0.2, -0.5):
        whole = arc((1.0, 2.0, 0.3), 7.0, curvature)
        np.testing.assert_allclose(arc(arc((1.0, 2.0, 0.3), 2.5, curvature), 4.5, curvature), whole, atol=1e-12)
        np.testing.assert_allclose(arc(whole, -7.0, curvature), (1.0, 2.0, 0.3), atol=1e-12)
    np.testing.assert_allclose(arc((0, 0, 0), np.pi * 5, 0.2), (0, 10, np.pi), atol=1e-12)  # half a circle


def test_projection_finds_the_distance_again(rng):
    for s in rng.uniform(0.5, SNAKE.length - 0.5, 50):
        x, y, yaw, _ = SNAKE.at(np.array(s))
        off = rng.uniform(-0.3, 0.3)
        found = SNAKE.project(x - off * np.sin(yaw), y + off * np.cos(yaw), s + rng.uniform(-1, 1))
        assert found == pytest.approx(s, abs=0.005)  # first order within a grid of 25 mm on curvature 1/4
