"""Motions of odometry against SE(3), their errors against Monte Carlo, and what is not believed."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.belief.motion_model import (
    Step,
    blind_step,
    compose_planar,
    odometry_step,
    planar_pose,
    relative_motion,
    sample_motion,
)
from mcl_depth.params import MotionParams
from sphere_nav.geometry import SE3

PARAMS = MotionParams(way_share=0.1, drift_deg=3.0, min_sigma=0.02, max_speed=4.0)


def test_planar_motions_are_those_of_se3():
    before, after = np.array([1.0, -2.0, 2.5]), np.array([3.0, 0.5, -1.0])
    motion = relative_motion(before, after)
    T = SE3.from_planar(*before).inverse() @ SE3.from_planar(*after)
    np.testing.assert_allclose(motion, planar_pose(T), atol=1e-12)
    poses = np.array([[1.0, -2.0, 2.5], [0.0, 4.0, -0.3]])
    expected = [planar_pose(SE3.from_planar(*pose) @ SE3.from_planar(*motion)) for pose in poses]
    np.testing.assert_allclose(compose_planar(poses, motion), expected, atol=1e-12)
    each = compose_planar(poses, np.array([motion, -motion]))
    np.testing.assert_allclose(each[0], expected[0], atol=1e-12)
    np.testing.assert_allclose(each[1], planar_pose(SE3.from_planar(*poses[1]) @ SE3.from_planar(*-motion)), atol=1e-12)


def test_sampled_motions_scatter_as_their_deviations_say_in_the_axes_of_the_pose():
    step = Step(np.array([2.0, -0.5, 0.4]), np.array([0.3, 0.1, 0.05]))
    start = np.array([1.0, 2.0, 2.0])
    poses = sample_motion(np.tile(start, (40_000, 1)), step, np.random.default_rng(0))
    motions = np.array([relative_motion(start, pose) for pose in poses])
    np.testing.assert_allclose(motions.mean(axis=0), step.motion, atol=0.006)  # four standard errors
    np.testing.assert_allclose(motions.std(axis=0), step.sigmas, rtol=0.02)


def test_the_deviations_grow_with_the_way_and_the_turn():
    step = odometry_step(np.array([1.6, -1.2, -0.8]), 2.0, PARAMS)
    position = np.hypot(0.1 * 2.0, 0.02)
    turn = np.sqrt((0.1 * 0.8) ** 2 + np.radians(3.0) ** 2 * 2.0 + np.radians(0.5) ** 2)
    np.testing.assert_allclose(step.sigmas, [position, position, turn])
    assert (step.is_known, step.jump) == (True, 0.0)


def test_drift_is_that_of_steps_of_any_length():
    """Deviations of the heading on a way of 4 m add up to the same in one step and in forty."""
    calm = MotionParams(drift_deg=2.0)
    found = []
    for count in (1, 40):
        step = odometry_step(np.array([4.0 / count, 0.0, 0.0]), 1.0, calm)
        found.append(np.degrees(np.sqrt(count * (step.sigmas[2] ** 2 - np.radians(0.5) ** 2))))
    np.testing.assert_allclose(found, 4.0, rtol=1e-9)


@pytest.mark.parametrize(("way", "is_known"), [(8.4, True), (-8.6, False)])
def test_odometry_faster_than_the_vehicle_by_half_a_metre_or_that_is_no_number_leaps(way, is_known):
    step = odometry_step(np.array([0.0, way, 0.0]), 2.0, PARAMS)  # at 4 m/s
    assert (step.is_known, step.jump) == (is_known, 0.0 if is_known else pytest.approx(8.6))
    assert odometry_step(np.array([np.nan, 0.0, 0.0]), 1.0, PARAMS).jump == 1e9


def test_without_odometry_the_vehicle_may_have_gone_anywhere_near():
    for seconds, sigmas in [(0.4, (0.2, 0.2, 0.14)), (30.0, (1.0, 1.0, np.pi / 4))]:
        step = blind_step(seconds)
        assert not step.is_known
        np.testing.assert_array_equal(step.motion, np.zeros(3))
        np.testing.assert_allclose(step.sigmas, sigmas)
