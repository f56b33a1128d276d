"""Steering: errors (eq. 22 to 24), law (eq. 25), and the poles that its gains promise."""

import math

import numpy as np
import pytest

from path_follower.params import SteeringParams
from path_follower.path import Pose2, ReferencePoint
from path_follower.steering import Errors, curvature_law, errors_of

PARAMS = SteeringParams()


def reference(speed=1.4, curvature=0.0, yaw=0.0, direction=1):
    return ReferencePoint(2.0, -1.0, yaw, speed, speed * curvature, curvature, 0.0, direction)


def test_errors_are_measured_in_the_axes_of_the_reference():
    point = reference(yaw=math.pi / 2)
    errors = errors_of(Pose2(1.7, -0.6, math.pi / 2 + 0.1), point)
    assert errors.longitudinal == pytest.approx(0.4)
    assert errors.lateral == pytest.approx(0.3)
    assert errors.yaw == pytest.approx(0.1)


def test_the_yaw_error_wraps():
    assert errors_of(Pose2(0, 0, -3.1), reference(yaw=3.1)).yaw == pytest.approx(2 * math.pi - 6.2)


def test_equation_25_for_the_yaw_rate():
    for curvature in [0.0, 0.2]:
        point, errors = reference(speed=1.2, curvature=curvature), Errors(0.1, 0.3, -0.2)
        expected = point.yaw_rate - PARAMS.k_y * 1.2 * 0.3 - PARAMS.k_psi * 1.2 * math.tan(-0.2)
        assert 1.2 * curvature_law(point, errors, PARAMS, 1.2) == pytest.approx(expected)


def closed_loop(direction, k_y_sign=1.0):
    """Poles by time of the linearized loop: e_y' = U e_psi, e_psi' = U curvature(e_y, e_psi)."""
    speed, step = direction * 1.0, 1e-6
    point = ReferencePoint(0, 0, 0, speed, 0, 0, 0, direction)

    def law(e_y, e_psi):
        return speed * curvature_law(point, Errors(0, k_y_sign * e_y, e_psi), PARAMS, abs(speed))

    return np.linalg.eigvals([[0, speed], [law(step, 0) / step, law(0, step) / step]])


def test_the_poles_are_those_of_the_docstring_forward_and_backward():
    for direction in [1, -1]:
        np.testing.assert_allclose(closed_loop(direction).real, -math.sqrt(PARAMS.k_y), rtol=1e-3)
        assert PARAMS.k_psi / (2 * math.sqrt(PARAMS.k_y)) == pytest.approx(1.0)


def test_backwards_the_lateral_term_as_printed_in_eq_25_would_be_unstable():
    assert closed_loop(-1, k_y_sign=-1.0).real.max() > 0.3


def test_the_bandwidth_in_time_is_bounded_and_keeps_the_damping():
    slow, fast = 1.0, 10.0
    omega = math.sqrt(PARAMS.k_y)
    lateral = -curvature_law(reference(fast), Errors(0, 1.0, 0), PARAMS, fast)
    heading = -curvature_law(reference(fast), Errors(0, 0, 1e-6), PARAMS, fast) / 1e-6
    assert math.sqrt(lateral) * fast == pytest.approx(2.5)
    assert heading / (2 * math.sqrt(lateral)) == pytest.approx(PARAMS.k_psi / (2 * omega), rel=1e-6)
    assert -curvature_law(reference(slow), Errors(0, 1.0, 0), PARAMS, slow) == pytest.approx(PARAMS.k_y)


def test_large_heading_errors_stay_finite_and_turn_the_right_way():
    for yaw in [math.pi / 2, -math.pi / 2, 3.0, -3.0]:
        found = curvature_law(reference(), Errors(0, 0, yaw), PARAMS, 1.4)
        factor = min(1.0, 2.5 / (math.sqrt(PARAMS.k_y) * 1.4))
        assert found == pytest.approx(-math.copysign(PARAMS.k_psi * factor * math.tan(1.0), yaw))


def test_the_law_exists_at_zero_reference_speed():
    assert curvature_law(reference(speed=0.0, curvature=0.1), Errors(0, 0.2, 0), PARAMS, 0.0) == pytest.approx(
        0.1 - PARAMS.k_y * 0.2
    )
