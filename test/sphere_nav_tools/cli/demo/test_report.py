"""Errors of a drive by the simulator's truth."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagWriter
from sphere_nav_tools.cli.demo.report import _crop_to_motion, distances_from_path, drive_errors

SECOND = 10**9


def test_distance_is_positive_to_the_left():
    path = np.stack([np.linspace(0, 10, 50), np.zeros(50)], axis=-1)
    along, lateral = distances_from_path(np.array([[1.0, 0.2], [2.0, -0.3], [3.0, 0.0]]), path)
    assert along == pytest.approx([1, 2, 3], abs=0.02)
    assert lateral == pytest.approx([0.2, -0.3, 0.0], abs=1e-6)


def test_a_path_that_crosses_itself_is_followed_in_order():
    t = np.linspace(0, 2 * np.pi, 2000)
    eight = np.stack([10 * np.sin(t), 5 * np.sin(2 * t)], axis=-1)
    along, lateral = distances_from_path(eight[::10], eight)
    assert np.all(np.diff(along) > -0.25)
    assert np.abs(lateral).max() < 0.02


def write_drive(path, offset, with_poses):
    """Drive 5 m straight at 1 m/s, `offset` m to the left."""
    with BagWriter(path) as bag:
        bag.add_topic("/ground_truth/odometry", Odometry)
        if with_poses:
            bag.add_topic("/pose", PoseWithCovarianceStamped)
        for i in range(251):
            stamp = SECOND + i * SECOND // 50
            T_world_base = SE3.from_planar(i / 50, offset, 0.0)
            truth = conversions.se3_to_odometry(
                T_world_base, np.zeros((6, 6)), stamp, ("world", "base_link"), np.zeros(6)
            )
            bag.write("/ground_truth/odometry", truth, stamp)
            if with_poses and i % 5 == 0:
                T_map_base = SE3.from_planar(0.1, 0.0, 0.0) @ T_world_base  # the map begins 0.1 m behind the world
                pose = conversions.se3_to_pose_with_covariance(T_map_base, np.eye(6), stamp, "map")
                bag.write("/pose", pose, stamp)


@pytest.mark.slow
def test_a_drive_beside_the_path_is_told_by_its_distance(tmp_path):
    write_drive(tmp_path / "teach", 0.0, with_poses=False)
    write_drive(tmp_path / "drive", 0.07, with_poses=True)
    errors = drive_errors(tmp_path / "teach", tmp_path / "drive", SE3.from_planar(-0.1, 0.0, 0.0))
    assert errors.lateral == pytest.approx(0.07, abs=1e-6)
    assert np.abs(errors.longitudinal).max() < 1e-6
    assert errors.share_driven > 0.99


def test_a_drive_that_stands_is_refused(tmp_path):
    with BagWriter(tmp_path / "still") as bag:
        bag.add_topic("/ground_truth/odometry", Odometry)
        for i in range(5):
            stamp = SECOND + i * SECOND
            odometry = conversions.se3_to_odometry(
                SE3.identity(), np.zeros((6, 6)), stamp, ("world", "base_link"), np.zeros(6)
            )
            bag.write("/ground_truth/odometry", odometry, stamp)
    with pytest.raises(ValueError, match="found one that stands"):
        drive_errors(tmp_path / "still", tmp_path / "still", SE3.identity())


def test_only_the_part_in_motion_counts():
    """Slower than 5 cm/s is standing, whatever the rate of the truth."""
    x = np.concatenate([np.arange(5) * 0.004, 0.016 + np.arange(1, 6) * 0.006, 0.046 + np.arange(1, 4) * 0.004])
    matrices = np.stack([SE3.from_planar(value, 0.0, 0.0).matrix for value in x])
    whole = Trajectory(SECOND + np.arange(len(x)) * SECOND // 10, SE3(matrices))  # 0.04, 0.06 and 0.04 m/s
    found = _crop_to_motion(whole)
    np.testing.assert_allclose(found.positions[[0, -1], 0], [0.016, 0.046], atol=1e-9)
    with pytest.raises(ValueError, match="found one that stands"):
        _crop_to_motion(whole[:5])
