"""Pictures of a drive are written and show something."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav_tools.cli.demo.plots import exaggerate, plot_errors, plot_top_view
from sphere_nav_tools.cli.demo.report import DriveErrors


@pytest.mark.slow
def test_both_pictures_hold_curves(tmp_path):
    s = np.linspace(0, 10, 60)
    path = np.stack([s, np.sin(s)], axis=-1)
    errors = DriveErrors(path, path + np.array([0.0, 0.05]), s, 0.05 * np.ones(60), 0.01 * np.cos(s), 1.0)
    poses = Trajectory(np.arange(60) * 10**8, SE3(np.tile(np.eye(4), (60, 1, 1))))
    plot_top_view(tmp_path / "top.png", errors, path[::20])
    plot_errors(tmp_path / "errors.png", errors, poses)
    for name in ("top.png", "errors.png"):
        picture = cv2.imread(str(tmp_path / name))
        colored = np.ptp(picture.astype(int), axis=-1) > 60
        assert colored.sum() > 200


def test_distances_from_the_path_are_exaggerated_to_their_side():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0]])
    along, lateral = np.array([0.5, 1.0, 3.5]), np.array([0.01, -0.02, 0.01])
    drawn = exaggerate(DriveErrors(path, path, along, lateral, np.zeros(3), 1.0), 50.0)
    np.testing.assert_allclose(drawn, [[0.5, 0.5], [1.0, -1.0], [1.5, 1.5]], atol=1e-12)  # left, right, left
