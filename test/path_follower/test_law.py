"""Steering (eq. 22 to 25) and speed (eq. 25): errors, laws, poles, the profile that a car can drive."""

import math
from dataclasses import replace

import numpy as np
import pytest

from path_follower.law import (
    Errors,
    TrackingError,
    bounded_speed,
    curvature_law,
    eased_speed,
    errors_of,
    speed_law,
    speed_limits,
    speed_profile,
)
from path_follower.params import SpeedParams, SteeringParams, VehicleParams
from path_follower.path import Location, Pose2, ReferencePoint
from path_follower.vehicle import Motion

SPEED = SpeedParams()
CAR = VehicleParams(max_acceleration=0.7, max_deceleration=1.1)  # unequal: exchanged ones are noticed
WAY = np.arange(0.0, 60.0, 0.1)


def reference(speed, direction=1):
    return ReferencePoint(0, 0, 0, speed, 0, 0, 0, direction)


def test_a_vehicle_that_is_ahead_is_slower_by_what_equation_25_says_and_does_not_drive_back():
    for ahead, speed in [(0.0, 1.4), (0.5, 0.8), (-0.5, 2.0)]:
        assert speed_law(reference(1.4), ahead) == pytest.approx(speed)
    assert speed_law(reference(0.5), 10.0) == 0.0
    assert speed_law(reference(-0.5, -1), -10.0) == 0.0
    assert speed_law(reference(0.0), -0.5) == pytest.approx(0.04)  # it creeps to where it should stand


def test_bends_are_slow_by_lateral_acceleration():
    bend = np.where((WAY > 20) & (WAY < 30), 0.8, 0.0)
    limit = speed_limits(WAY, bend, SPEED, CAR)
    assert limit[250] == pytest.approx(math.sqrt(SPEED.lateral_acceleration / 0.8))
    assert limit[100] == SPEED.cruise


def test_changes_of_curvature_are_slow_by_the_steering_rate():
    bend = np.interp(WAY, [20, 20.5], [0.0, 0.35])
    speed = speed_limits(WAY, bend, SPEED, CAR)
    angle = np.arctan(CAR.wheelbase * bend)
    rate = np.gradient(angle, WAY) * speed
    assert rate.max() <= CAR.max_steering_rate * (1 + 1e-9)
    assert speed.min() < SPEED.cruise


def test_a_profile_never_asks_for_more_than_the_car_gives():
    limits = np.interp(WAY, [0, 19, 20, 25, 26, 60], [1.4, 1.4, 0.4, 0.4, 1.4, 1.4])
    speed = speed_profile(WAY, limits, CAR)
    gain = np.diff(speed**2) / (2 * np.diff(WAY))
    assert np.all(speed <= limits + 1e-12)
    assert gain.max() <= CAR.max_acceleration + 1e-9
    assert gain.min() >= -CAR.max_deceleration - 1e-9
    assert speed[0] == pytest.approx(1.4)
    assert speed[-1] == 0.0


def test_a_speed_is_read_earlier_by_as_much_as_bounded_jerk_follows_late():
    for gain, jerk, lead in [(0.0, 2.0, 0.77), (-0.5, 2.0, 0.77), (0.7, 2.0, 1.5398), (0.0, 4.0, 0.385)]:
        car = replace(CAR, max_jerk=jerk)
        tracking = TrackingError(Errors(0, 0, 0), reference(1.4), Location(0, 0, 0, 0, 0, 0), 9.0)
        assert eased_speed(Ramp(), tracking, Motion(-1.4, 0.0), gain, car) == pytest.approx(lead, abs=1e-4)


class Ramp:
    """A path whose speed, backwards, is the arc length."""

    def at(self, arc_length, segment):
        return reference(-arc_length, -1)


def tracking(remaining, direction=1):
    return TrackingError(Errors(0, 0, 0), reference(1.0 * direction, direction), Location(0, 0, 0, 0, 0, 0), remaining)


def test_a_vehicle_creeps_the_last_steps_and_then_stands():
    for direction in [1, -1]:
        far = bounded_speed(direction * 0.01, tracking(0.3, direction), slow=2.0, is_starting=False)
        there = bounded_speed(direction * 0.01, tracking(0.04, direction), slow=2.0, is_starting=False)
        assert far == direction * 0.1
        assert there == 0.0
        assert bounded_speed(0.0, tracking(0.06, direction), slow=2.0, is_starting=False) == far


def test_slow_and_start_bound_the_speed():
    assert bounded_speed(1.4, tracking(9.0), slow=0.5, is_starting=False) == 0.5
    assert bounded_speed(1.4, tracking(9.0), slow=2.0, is_starting=True) == 0.1


PARAMS = SteeringParams()


def turned(speed=1.4, curvature=0.0, yaw=0.0):
    return ReferencePoint(2.0, -1.0, yaw, speed, speed * curvature, curvature, 0.0, 1)


def test_errors_are_measured_in_the_axes_of_the_reference_and_across_the_half_turn():
    point = turned(yaw=math.pi / 2)
    errors = errors_of(Pose2(1.7, -0.6, math.pi / 2 + 0.1), point)
    assert errors.longitudinal == pytest.approx(0.4)
    assert errors.lateral == pytest.approx(0.3)
    assert errors.yaw == pytest.approx(0.1)
    assert errors_of(Pose2(0, 0, -3.1), turned(yaw=3.1)).yaw == pytest.approx(2 * math.pi - 6.2)


def test_equation_25_for_the_yaw_rate():
    for curvature in [0.0, 0.2]:
        point, errors = turned(speed=1.2, curvature=curvature), Errors(0.1, 0.3, -0.2)
        expected = point.yaw_rate - PARAMS.k_y * 1.2 * 0.3 - PARAMS.k_psi * 1.2 * math.tan(-0.2)
        assert 1.2 * curvature_law(point, errors, PARAMS, 1.2) == pytest.approx(expected)


def closed_loop(direction):
    """Poles by time of the linearized loop: e_y' = U e_psi, e_psi' = U curvature(e_y, e_psi)."""
    speed, step = direction * 1.0, 1e-6
    point = ReferencePoint(0, 0, 0, speed, 0, 0, 0, direction)

    def law(e_y, e_psi):
        return speed * curvature_law(point, Errors(0, e_y, e_psi), PARAMS, abs(speed))

    return np.linalg.eigvals([[0, speed], [law(step, 0) / step, law(0, step) / step]])


def test_a_heading_or_offset_dies_out_forward_and_backward():
    for direction in [1, -1]:
        np.testing.assert_allclose(closed_loop(direction).real, -math.sqrt(PARAMS.k_y), rtol=1e-3)
        assert PARAMS.k_psi / (2 * math.sqrt(PARAMS.k_y)) == pytest.approx(1.0)


def test_a_fast_vehicle_steers_no_faster_than_the_loop_allows():
    slow, fast = 1.0, 10.0
    omega = math.sqrt(PARAMS.k_y)
    lateral = -curvature_law(turned(fast), Errors(0, 1.0, 0), PARAMS, fast)
    heading = -curvature_law(turned(fast), Errors(0, 0, 1e-6), PARAMS, fast) / 1e-6
    assert math.sqrt(lateral) * fast == pytest.approx(2.5)
    assert heading / (2 * math.sqrt(lateral)) == pytest.approx(PARAMS.k_psi / (2 * omega), rel=1e-6)
    assert -curvature_law(turned(slow), Errors(0, 1.0, 0), PARAMS, slow) == pytest.approx(PARAMS.k_y)


def test_large_heading_errors_stay_finite_and_turn_the_right_way():
    for yaw in [math.pi / 2, -math.pi / 2, 3.0, -3.0]:
        found = curvature_law(turned(), Errors(0, 0, yaw), PARAMS, 1.4)
        factor = min(1.0, 2.5 / (math.sqrt(PARAMS.k_y) * 1.4))
        assert found == pytest.approx(-math.copysign(PARAMS.k_psi * factor * math.tan(1.0), yaw))


def test_a_vehicle_at_rest_steers_by_finite_numbers():
    assert curvature_law(turned(speed=0.0, curvature=0.1), Errors(0, 0.2, 0), PARAMS, 0.0) == pytest.approx(
        0.1 - PARAMS.k_y * 0.2
    )
