"""Which pairs of a drive are compared: with parallax, without much turn, no part of the way twice."""

from itertools import pairwise

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.offline.mapping.depth_drive import MAX_PARALLAX, MAX_TURN, choose_pairs, velocity_at


def drive(poses):
    return Trajectory(np.arange(len(poses)) * 100_000_000, SE3(np.stack([pose.matrix for pose in poses])))


def test_pairs_have_parallax_and_follow_each_other():
    way = drive([SE3.from_planar(0.05 * k, 0.0, 0.01 * k) for k in range(200)])
    pairs = choose_pairs(way, 2.0)
    assert len(pairs) > 8
    assert all(first < second for first, second in pairs)
    assert all(before[1] <= after[0] for before, after in pairwise(pairs))
    lengths = [way.T_map_body[first].distance(way.T_map_body[second]) for first, second in pairs]
    assert all(length >= MAX_PARALLAX * 2.0 - 1e-9 and turn <= MAX_TURN for length, turn in lengths)


def test_a_camera_that_only_turns_has_no_pairs():
    assert choose_pairs(drive([SE3.from_planar(0.0, 0.0, 0.05 * k) for k in range(50)]), 2.0) == []


def test_the_velocity_is_that_of_the_optical_axes():
    way = drive([SE3.from_planar(0.1 * k, 0.0, 0.0) for k in range(5)])  # ahead is z of the camera
    for index in (0, 2, 4):
        np.testing.assert_allclose(velocity_at(way, index), [0, 0, 1, 0, 0, 0], atol=1e-12)
