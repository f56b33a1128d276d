"""A turn in three moves as a path that the follower takes."""

import numpy as np
import pytest

from path_follower.params import FollowerParams
from path_follower.path_files import read_path
from sphere_nav_tools.cli.demo.report import distances_from_path
from sphere_nav_tools.cli.experiment.plans import turn_around, write_plan

# Written out: imported, a change would go unseen.
TURN_RADIUS = 3.5

STRAIGHT = np.column_stack([np.arange(0.0, 9.1, 1.5), np.full(7, 2.0), np.zeros(7)])


def test_a_turn_in_three_moves_ends_where_it_began_and_looks_back():
    poses, speeds = turn_around(STRAIGHT)
    assert len(poses) == len(speeds)
    assert poses[-1] == pytest.approx([0.0, 2.0, np.pi], abs=1e-9)
    assert poses[:7] == pytest.approx(STRAIGHT)
    turn = poses[7:-6]
    assert turn[-1] == pytest.approx([9.0, 2.0, np.pi], abs=1e-9)
    assert [turn[:, 1].min(), turn[:, 1].max()] == pytest.approx([2.0 - TURN_RADIUS / 2, 2.0 + TURN_RADIUS / 2])


def test_the_follower_takes_it_with_two_cusps(tmp_path):
    path = read_path(write_plan(tmp_path / "plan.csv", *turn_around(STRAIGHT)), FollowerParams())
    assert [segment.direction for segment in path.segments] == [1, -1, 1]
    assert np.abs(path.curvature).max() < 1.2 / TURN_RADIUS
    assert np.abs(path.speed).max() == pytest.approx(1.0)


def test_a_drive_along_it_is_not_beside_it():
    """Beyond a cusp a car is off along the way, not across it."""
    poses, _ = turn_around(STRAIGHT)
    along, lateral = distances_from_path(poses[:, :2], poses[:, :2], poses[:, 2])
    assert np.abs(lateral).max() < 0.01
    assert along[-1] == pytest.approx(18.0 + TURN_RADIUS * np.pi, abs=0.05)
    cusp = int(np.argmax(poses[:, 1]))
    x, y, yaw = poses[cusp]
    beyond = poses[: cusp + 1, :2].copy()
    beyond[-1] = [x + 0.05 * np.cos(yaw), y + 0.05 * np.sin(yaw)]
    assert abs(distances_from_path(beyond, poses[:, :2], poses[:, 2])[1][-1]) < 0.01
