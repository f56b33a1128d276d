"""Which pairs of a drive are compared: with parallax, without much turn, no part of the way twice."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav_tools.offline.mapping.depth_drive import DepthEstimate, choose_pairs, velocity_at

# Written out: imported, a change would go unseen.
MAX_TURN, PARALLAX = np.radians(15.0), (0.03, 0.15)


def drive(poses):
    return Trajectory(np.arange(len(poses)) * 100_000_000, SE3(np.stack([pose.matrix for pose in poses])))


def test_pairs_have_parallax_and_follow_each_other():
    way = drive([SE3.from_planar(0.05 * k, 0.0, 0.01 * k) for k in range(200)])
    pairs = choose_pairs(way, 2.0)
    assert len(pairs) > 8
    assert all(first < second for first, second in pairs)
    assert all(before[1] <= after[0] for before, after in pairwise(pairs))
    lengths = [way.T_map_body[first].distance(way.T_map_body[second]) for first, second in pairs]
    assert all(length >= PARALLAX[1] * 2.0 - 1e-9 and turn <= MAX_TURN for length, turn in lengths)


def test_pairs_share_the_way_within_the_bounds_of_parallax():
    for length, range_m, reach in [(1.6, 2.0, 0.10), (0.4, 2.0, 0.06), (40.0, 2.0, 0.30)]:
        count = 2000
        way = drive([SE3.from_planar(length * k / count, 0.0, 0.0) for k in range(count + 1)])
        pairs = choose_pairs(way, range_m)
        moved = [float(way.T_map_body[a].distance(way.T_map_body[b])[0]) for a, b in pairs]
        assert min(moved) == pytest.approx(reach, abs=length / count + 1e-9)
        assert max(moved) == pytest.approx(reach, abs=2 * length / count + 1e-9)
        assert len(pairs) <= 32


def test_a_pair_turns_by_fifteen_degrees_at_most():
    for turn_deg, is_kept in [(14.0, True), (16.0, False)]:
        poses = [SE3.from_planar(0.3 * k, 0.0, np.radians(turn_deg) * k) for k in range(5)]
        assert bool(choose_pairs(drive(poses), 2.0)) == is_kept


def test_the_velocity_keeps_its_sides_and_is_by_seconds():
    way = drive([SE3.from_planar(0.0, -0.1 * k, 0.05 * k) for k in range(5)])  # to the right, turning left
    found = velocity_at(way, 0)
    assert found[0] == pytest.approx(1.0, abs=0.05)  # x of the optical axes is to the right
    assert found[4] == pytest.approx(-0.5)  # about y, which looks down


def test_a_verdict_tells_millimeters_and_degrees_with_their_signs():
    T_used = SE3.exp([0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    T_found = SE3.exp([-0.003, 0.0, 0.0, 0.0, np.radians(-0.5), 0.0]) @ T_used
    sigma = np.array([0.001, 0.002, 0.003, *np.radians([0.1, 0.2, 0.3])])
    found = SimpleNamespace(T_image_depth=T_found, covariance=np.diag(sigma**2), contradicts=lambda T: T is T_used)
    line = DepthEstimate(found, T_used).verdict
    assert "x -3.00 +- 1.00, y +0.00 +- 2.00, z " in line
    assert "ry -0.50 +- 0.20" in line
    assert "false alarm 0.1%" in line
    assert DepthEstimate(found, T_found).verdict == ""
