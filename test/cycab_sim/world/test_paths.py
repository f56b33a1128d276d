import numpy as np
import pytest

from cycab_sim.world.paths import Path, Piece, turn

SNAKE = Path((1.0, 2.0, 0.3), (Piece(5.0), turn(4.0, 90), Piece(3.0), turn(6.0, -45), Piece(2.0)))


def test_projection_finds_the_distance_again(rng):
    for s in rng.uniform(0.5, SNAKE.length - 0.5, 50):
        x, y, yaw, _ = SNAKE.at(np.array(s))
        off = rng.uniform(-0.3, 0.3)
        found = SNAKE.project(x - off * np.sin(yaw), y + off * np.cos(yaw), s + rng.uniform(-1, 1))
        assert found == pytest.approx(s, abs=0.005)  # first order within a grid of 25 mm on curvature 1/4
