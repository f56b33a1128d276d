"""From taught poses to the trajectory: directions, cusps, speeds, and every reason to refuse a path (F22)."""

import numpy as np
import pytest

from path_follower.params import FollowerParams, PathParams, SpeedParams
from path_follower.smoothing import Curve, smooth_curve
from path_follower.taught import taught_speeds

PARAMS = FollowerParams()


def with_noise(poses, position=0.02, yaw=0.01):
    rng = np.random.default_rng(0)
    return poses + rng.normal(size=poses.shape) * (position, position, yaw)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_cusps_are_found_where_the_vehicle_turned_back(kit, noise):
    poses = with_noise(kit.course((6, 0), (-4, 0.2), (5, -0.2)), noise, noise / 2)
    path = kit.make_path(poses[:, :2], PARAMS, poses[:, 2])
    assert [segment.direction for segment in path.segments] == [1, -1, 1]
    ends = [path.arc_length[segment.last] for segment in path.segments]
    np.testing.assert_allclose(ends, [6, 10, 15], atol=0.05 + 5 * noise)
    np.testing.assert_allclose(path.speed[[s.last for s in path.segments]], 0.0)


def test_standing_still_with_noise_is_no_change_of_direction(kit):
    poses = np.concatenate([kit.course((5, 0)), np.tile([5.0, 0, 0], (200, 1)), kit.course((5, 0), start=(5, 0, 0))])
    path = kit.make_path(with_noise(poses)[:, :2], PARAMS, with_noise(poses)[:, 2])
    assert len(path.segments) == 1
    assert path.length == pytest.approx(10.0, abs=0.15)


def test_orientations_left_at_their_default_are_not_taken_for_headings(kit):
    poses = kit.course((4, 0), (6, 0.25), (5, 0))
    path = kit.make_path(poses[:, :2], PARAMS, np.zeros(len(poses)))
    assert len(path.segments) == 1
    assert path.yaw[-1] == pytest.approx(1.5, abs=0.02)


NAN_AT_3 = np.array([[0, 0], [1, 0], [2, 0], [np.nan, 0], [4, 0]])


def test_a_path_that_cannot_be_driven_is_refused_in_one_line(kit):
    for points, yaw, message in [
        (np.empty((0, 2)), None, r"expected 2 to 1000000 points \(x, y\), found 0"),
        (NAN_AT_3, None, "point 3: expected finite numbers"),
        ([[0, 0], [1, 0], [2, 0]], [0, np.nan, 0], r"point 1: expected finite numbers, found \[1.0, 0.0, nan\]"),
        ([[0, 0], [0.05, 0]], None, "expected a length of 0.2 to 100000 m, found 0.05 m"),
        ([[0, 0], [1, 0], [23542, 0]], None, "point 2: expected at most 1000 m from the last, found 2.354e"),
        ([[0, 0], [1, 0], [2, 0], [3, 0]], [1.5, 1.6, 1.5, 1.6], "yaw: expected along the way, as a car drives"),
    ]:
        with pytest.raises(ValueError, match=message) as caught:
            kit.make_path(points, PARAMS, yaw)
        assert "\n" not in str(caught.value)


def test_taught_speeds_come_from_stamps_and_do_not_see_noise(kit):
    poses = with_noise(kit.course((20, 0)))
    stamps = (np.arange(len(poses)) * 0.05 / 1.1 * 1e9).astype(np.int64)  # 1.1 m/s
    speeds = taught_speeds(poses[:, :2], stamps)
    # Positions 1 m apart, each off by 2 cm: 3 % of 1.1 m/s, four times.
    assert np.abs(speeds[20:-20] - 1.1).max() < 0.14


def test_a_vehicle_is_not_faster_than_it_was_taught_unless_switched_off(kit):
    poses = kit.course((30, 0))
    slow = np.full(len(poses), 0.7)
    assert kit.make_path(poses[:, :2], PARAMS, poses[:, 2], slow).speed.max() == pytest.approx(0.7)
    free = FollowerParams(speed=SpeedParams(is_as_taught=False))
    assert kit.make_path(poses[:, :2], free, poses[:, 2], slow).speed.max() == pytest.approx(1.4)
    standing = np.zeros(len(poses))
    assert kit.make_path(poses[:, :2], PARAMS, poses[:, 2], standing).speed.max() == pytest.approx(0.3)


def test_another_cruise_speed_is_as_if_it_had_been_there_from_the_start(kit):
    for cruise in [0.3, 0.9, 1.7, 5.0]:
        poses = kit.course((6, 0), (-4, 0.2), (5, -0.2))
        made = kit.make_path(poses[:, :2], FollowerParams(speed=SpeedParams(cruise=cruise)), poses[:, 2])
        changed = kit.make_path(poses[:, :2], FollowerParams(speed=SpeedParams(cruise=0.5)), poses[:, 2]).at_cruise(
            cruise
        )
        np.testing.assert_allclose(changed.speed, made.speed, atol=1e-12)
        assert np.abs(made.speed).max() <= cruise


SPACING = 0.1

SMOOTHING = PathParams()


def circle(radius, turn, spacing):
    angle = np.arange(0.0, turn, spacing / radius)
    return radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)


def test_a_circle_keeps_its_radius():
    for spacing in [0.02, 0.1, 1.0]:
        for radius in [3.0, 10.0]:
            curve = smooth_curve(circle(radius, 5.0, spacing), SMOOTHING)
            inner = slice(20, -20)  # the ends know one side only
            np.testing.assert_allclose(curve.bend[inner], 1 / radius, rtol=0.01)
            # Averages over the 0.2 m of a bin lie inside by 0.2^2 / 24 / radius at most.
            np.testing.assert_allclose(np.hypot(curve.x, curve.y - radius), radius, atol=0.003)
            assert np.ptp(np.diff(curve.arc)) < 0.02 * SPACING
            assert np.diff(curve.arc).mean() == pytest.approx(0.1, rel=0.02)


def test_noise_of_two_centimeters_does_not_reach_the_curvature():
    clean = np.stack([np.arange(0, 30, 0.05), np.zeros(600)], axis=-1)
    noisy = clean + np.random.default_rng(0).normal(0, 0.02, clean.shape)
    curve = smooth_curve(noisy, SMOOTHING)
    assert np.sqrt(np.mean(curve.y**2)) < 0.01
    assert np.sqrt(np.mean(curve.bend[10:-10] ** 2)) < 0.03  # a wheel moved by two degrees
    assert curve.arc[-1] == pytest.approx(30.0, abs=0.1)  # zigzags would lengthen it


def test_a_wave_of_the_smoothing_length_is_halved():
    for wavelength, gain in [(2.0, 0.5), (20.0, 1.0), (0.75, 0.0)]:
        x = np.linspace(0, 60, 285, endpoint=False)  # wide enough not to be averaged
        curve = smooth_curve(np.stack([x, 1e-2 * np.sin(2 * np.pi * x / wavelength)], axis=-1), SMOOTHING)
        inner = (curve.arc > 10) & (curve.arc < 50)
        found = np.sqrt(2) * np.std(curve.y[inner]) / 1e-2
        assert found == pytest.approx(gain, abs=0.03)


def test_a_turn_on_the_spot_bends_as_over_a_nanometre_a_point():
    curve = Curve(np.zeros(4), np.zeros(4), 1e-3 * np.arange(4), np.ones(4))
    np.testing.assert_allclose(curve.bend, 1e6)


def test_points_of_a_curve_are_joined_by_a_curve_and_corners_by_straight_lines():
    for bend, is_curve in [(0.5, True), (0.7, False)]:
        angles = bend * np.arange(5)
        points = 5.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        curve = smooth_curve(points, PathParams(smoothing_length=0.0))
        lowest = np.hypot(curve.x, curve.y).min()
        assert lowest == pytest.approx(5.0 if is_curve else 5.0 * np.cos(bend / 2), abs=0.03)
