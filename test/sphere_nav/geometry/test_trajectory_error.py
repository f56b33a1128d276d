"""Errors of trajectories: known motions come back, each error is measured along its own axis."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.geometry.trajectory_error import (
    Statistics,
    absolute_errors,
    align_trajectories,
    directions_of_motion,
    nees,
    relative_errors,
)


def drive(num_poses=400, step_m=0.05):
    """An S-curve on a slope, heading along the way."""
    s = np.arange(num_poses) * step_m
    yaw = np.sin(s / 3.0)
    position = np.column_stack([np.cumsum(np.cos(yaw)), np.cumsum(np.sin(yaw)), 0.1 * s / step_m]) * step_m
    rotation = SE3.exp(np.column_stack([np.zeros((num_poses, 5)), yaw])).rotation
    return Trajectory(np.arange(num_poses) * 10**8, SE3.from_parts(rotation, position))


TRUTH = drive()


def disturbed(xi):
    return Trajectory(TRUTH.stamps_ns, TRUTH.T_map_body @ SE3.exp(xi))


def test_lateral_is_left_and_longitudinal_is_ahead_of_the_motion():
    for offset, lateral, longitudinal in [((0, 0.3, 0), 0.3, 0.0), ((-0.2, 0, 0.1), 0.0, -0.2)]:
        errors = absolute_errors(disturbed([*offset, 0, 0, 0]), TRUTH, directions_of_motion(TRUTH))
        inner = slice(10, -10)  # at the ends the direction is one-sided
        np.testing.assert_allclose(errors.lateral_m[inner], lateral, atol=1e-2 * np.linalg.norm(offset))
        np.testing.assert_allclose(errors.longitudinal_m[inner], longitudinal, atol=1e-2 * np.linalg.norm(offset))
        np.testing.assert_allclose(errors.translation_m, np.linalg.norm(offset), atol=1e-12)
        np.testing.assert_allclose(errors.rotation_rad, 0.0, atol=1e-7)


def test_errors_are_summed_up_by_their_size_and_unknown_ones_do_not_count():
    assert Statistics.of(np.array([1.0, -7.0, np.nan, np.inf])) == Statistics(4.0, 5.0, pytest.approx(6.7), 7.0)
    assert Statistics.of(np.array([np.nan])) is None


def test_direction_is_known_at_standstill_and_without_any_motion():
    stop = np.concatenate([np.arange(200), np.full(50, 200), np.arange(200, 399)])
    stamps = np.arange(len(stop))
    directions = directions_of_motion(Trajectory(stamps, TRUTH.T_map_body[stop]))
    np.testing.assert_allclose(directions[200:250], np.tile(directions[225], (50, 1)), atol=1e-12)
    yaw = TRUTH.T_map_body.yaw[200]
    np.testing.assert_allclose(directions[225], [np.cos(yaw), np.sin(yaw)], atol=1e-2)
    parked = Trajectory(np.arange(5), SE3(np.repeat(SE3.from_planar(1, 2, 0.7).matrix[None], 5, axis=0)))
    np.testing.assert_allclose(directions_of_motion(parked), np.tile([np.cos(0.7), np.sin(0.7)], (5, 1)))


def test_alignment_finds_a_known_motion_and_scale_and_mirrors_nothing_back():
    for kind, scale in [("se3", 1.0), ("sim3", 0.8)]:
        T_truth_estimate = SE3.exp([1.0, -2.0, 0.5, 0.3, -0.2, 2.0])
        estimate = TRUTH.moved(T_truth_estimate.inverse())
        estimate = estimate.moved(SE3.identity(), 1 / scale)
        found, found_scale = align_trajectories(estimate, TRUTH, kind)
        assert found_scale == pytest.approx(scale, rel=1e-9)
        aligned = estimate.moved(found, found_scale)
        np.testing.assert_allclose(aligned.positions, TRUTH.positions, atol=1e-9)
        np.testing.assert_allclose(aligned.T_map_body.rotation, TRUTH.T_map_body.rotation, atol=1e-9)
    mirrored = SE3.from_parts(TRUTH.T_map_body.rotation, TRUTH.positions * (1.0, 1.0, -1.0))
    T_truth_estimate, _ = align_trajectories(Trajectory(TRUTH.stamps_ns, mirrored), TRUTH, "se3")
    assert np.linalg.det(T_truth_estimate.rotation) == pytest.approx(1.0)


def test_no_alignment_is_identity_and_a_line_cannot_be_aligned():
    found, scale = align_trajectories(TRUTH, TRUTH, "none")
    np.testing.assert_array_equal(found.matrix, np.eye(4))
    assert scale == 1.0
    line = Trajectory(np.arange(9), SE3.from_parts(np.eye(3), np.outer(np.arange(9), [1.0, 2.0, 0.0])))
    with pytest.raises(ValueError, match="not on one line, found 9 poses"):
        align_trajectories(line, line, "se3")


def test_relative_errors_see_drift_and_not_an_offset():
    offset = TRUTH.moved(SE3.exp([5.0, 1.0, 0, 0.1, 0.2, 0.3]))
    np.testing.assert_allclose(relative_errors(offset, TRUTH, 2.0).translation_m, 0.0, atol=1e-9)
    stretched = TRUTH.moved(SE3.identity(), 1.02)
    drift = relative_errors(stretched, TRUTH, 2.0)
    assert np.all(np.abs(drift.length_m - 2.0) <= 0.2)
    assert np.all(drift.length_m < 2.0 + 2 * 0.06)  # at most one pose further than asked
    assert np.median(drift.translation_m / drift.length_m) == pytest.approx(0.02, rel=0.05)  # chord against way


def test_nees_of_honest_covariances_is_six_and_of_proud_ones_larger():
    rng = np.random.default_rng(2)
    factor = 0.01 * rng.normal(size=(6, 6))
    covariance = factor @ factor.T + 1e-6 * np.eye(6)
    xi = rng.multivariate_normal(np.zeros(6), covariance, size=len(TRUTH))
    for pride, expected in ((1.0, 6.0), (4.0, 24.0)):
        claimed = np.repeat(covariance[None] / pride, len(TRUTH), axis=0)
        estimate = Trajectory(TRUTH.stamps_ns, TRUTH.T_map_body @ SE3.exp(xi).inverse(), claimed)
        # The mean of 400 chi-squared numbers of 6 degrees has a standard deviation of 0.17: four of these.
        assert np.mean(nees(estimate, TRUTH)) == pytest.approx(expected, abs=0.7 * pride)


def test_nees_is_unknown_without_a_usable_covariance():
    assert np.isnan(nees(TRUTH, TRUTH)).all()
    covariances = np.repeat(np.eye(6)[None], len(TRUTH), axis=0)
    covariances[0], covariances[1, 2, 2], covariances[2, 0, 0] = 0.0, np.nan, -1.0
    found = nees(Trajectory(TRUTH.stamps_ns, TRUTH.T_map_body, covariances), TRUTH)
    assert np.isnan(found[:3]).all()
    np.testing.assert_allclose(found[3:], 0.0, atol=1e-12)


def straight(num_poses=120, step_m=0.02):
    """A level way straight on but for a millimetre, heading along it."""
    way = np.arange(num_poses)
    place = np.column_stack([way * step_m, 1e-3 * np.sin(way), 1e-3 * np.cos(2 * way)])
    return Trajectory(np.arange(num_poses) * 10**8, SE3.from_parts(np.repeat(np.eye(3)[None], num_poses, 0), place))


def test_poses_that_agree_are_aligned_exactly_and_wrong_ones_or_an_anchor_that_is_off_do_not_pull():
    for way in [straight(), TRUTH[:1], TRUTH]:
        T_truth_estimate = SE3.exp([1.0, -2.0, 0.5, 0.3, -0.2, 2.0])
        found, scale = align_trajectories(way.moved(T_truth_estimate.inverse()), way, "poses")
        assert scale == 1.0
        np.testing.assert_allclose(found.matrix, T_truth_estimate.matrix, atol=1e-8)
    noise = np.random.default_rng(5).normal(size=(len(TRUTH), 6)) * np.repeat([0.002, 0.001], 3)
    estimate = disturbed(noise)
    wrong = np.arange(0, len(TRUTH), 5)
    poses = estimate.T_map_body.matrix.copy()
    poses[wrong] = SE3(poses[wrong]).matrix @ SE3.exp([0.5, 0.4, 0.3, 0.2, 0.3, 0.5]).matrix
    T_map_truth = SE3.exp([0.007, 0.003, -0.002, 0.0, 0.0, 0.004])  # the first pose of the map, taken for the frame
    moved = Trajectory(TRUTH.stamps_ns, SE3(poses)).moved(T_map_truth)
    found, _ = align_trajectories(moved, TRUTH, "poses")
    meters, radians = (found @ T_map_truth).distance(SE3.identity())
    assert meters < 1e-3
    assert radians < 3e-4


def test_a_stretch_is_of_the_pose_that_is_nearest_to_its_length():
    truth = straight(11, 0.3)
    found = relative_errors(truth, truth, 0.95)
    np.testing.assert_allclose(found.length_m, 0.9, rtol=1e-3)  # 1.2 m is farther from 0.95 m
    assert len(found.length_m) == 8
    assert len(relative_errors(truth, truth, 1.05).length_m) == 0  # none within a tenth
    still = Trajectory(np.arange(5), SE3(np.repeat(np.eye(4)[None], 5, axis=0)))
    assert len(relative_errors(still, still, 1.0).length_m) == 0
