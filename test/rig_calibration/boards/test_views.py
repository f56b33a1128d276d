"""Rows of the adjustment, and how steps move a state."""

import numpy as np

from rig_calibration.boards.board import Board
from rig_calibration.boards.state import camera_state
from rig_calibration.boards.views import BoardView, camera_observations
from sphere_nav.geometry import SE3


def test_corners_of_views_stand_one_below_the_other():
    board = Board("b", 4, 3, 0.1)
    views = [BoardView("c", str(n), "b", np.arange(5 + n), np.full((5 + n, 2), float(n))) for n in range(2)]
    seen = camera_observations(views, {"b": board})
    assert seen.starts.tolist() == [0, 5, 11]


def test_a_step_moves_poses_from_the_right():
    step = np.array([[0.1, 0.2, 0.3, 0.01, 0.02, 0.03]])
    T = SE3.exp(np.ones((1, 6)))
    moved = camera_state(np.zeros(12), T.inverse()).moved(np.append(np.zeros(24), step))
    np.testing.assert_allclose(moved.T_world_rig.matrix, (T @ SE3.exp(step)).matrix, atol=1e-12)
