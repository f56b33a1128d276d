import math
from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState, WheelErrors, WheelOdometry

PARAMS = CarParams()
INSTANT = ActuatorParams(steering_lag=0.0, speed_lag=0.0)


def drive(state, command, seconds, step=0.01, actuation=INSTANT):
    vehicle = Vehicle(state, PARAMS, actuation)
    for _ in range(round(seconds / step)):
        vehicle.step(command, step)
    return vehicle


def test_constant_steering_is_a_circle_whatever_the_step():
    for speed in [1.0, -1.0]:
        steering = 0.3
        radius = PARAMS.wheelbase / math.tan(steering)
        command = VehicleCommand(speed, speed / radius)
        vehicle = drive(VehicleState(speed=speed, steering=steering), command, 4.0, 0.1)
        angle = speed * 4.0 / radius
        state = vehicle.state
        expected = (radius * math.sin(angle), radius * (1 - math.cos(angle)), angle)
        assert (state.x, state.y, state.yaw) == pytest.approx(expected, abs=1e-9)
        assert vehicle.yaw_rate == pytest.approx(speed / radius)


def test_a_yaw_rate_is_not_a_steering_angle():
    vehicle = drive(VehicleState(), VehicleCommand(2.0, 0.5), 6.0)
    assert vehicle.yaw_rate == pytest.approx(0.5)
    assert vehicle.state.steering == pytest.approx(math.atan(PARAMS.wheelbase * 0.5 / 2.0))


def test_limits_hold_whatever_is_asked_for():
    vehicle = Vehicle(VehicleState(), PARAMS, INSTANT)
    before = vehicle.state
    rng = np.random.default_rng(3)
    for _ in range(2000):
        vehicle.step(VehicleCommand(*rng.normal(scale=20.0, size=2)), 0.01)
        now = vehicle.state
        assert -PARAMS.max_reverse_speed <= now.speed <= PARAMS.max_speed
        assert abs(now.steering) <= PARAMS.max_steering_angle + 1e-12
        assert abs(now.steering - before.steering) <= PARAMS.max_steering_rate * 0.01 + 1e-12
        assert now.speed - before.speed <= PARAMS.max_deceleration * 0.01 + 1e-12
        assert abs(now.speed) - abs(before.speed) <= PARAMS.max_acceleration * 0.01 + 1e-12
        before = now


def test_actuators_follow_with_their_time_constant_after_their_dead_time():
    slow = ActuatorParams(speed_lag=0.5, steering_lag=0.0)
    gentle = drive(VehicleState(speed=1.0), VehicleCommand(1.2, 0.0), 0.5, actuation=slow)
    assert gentle.state.speed == pytest.approx(1.2 - 0.2 * math.exp(-1.0), abs=1e-9)
    turning = ActuatorParams(speed_lag=0.0, steering_lag=0.5)
    wanted = 0.05
    rate = 1.0 * math.tan(wanted) / PARAMS.wheelbase
    turned = drive(VehicleState(speed=1.0), VehicleCommand(1.0, rate), 0.5, actuation=turning)
    assert turned.state.steering == pytest.approx(wanted * (1 - math.exp(-1.0)), abs=1e-9)
    dead = ActuatorParams(dead_time=0.3, speed_lag=0.0, steering_lag=0.0)
    assert drive(VehicleState(), VehicleCommand(1.0, 0.0), 0.3, actuation=dead).state.speed == 0.0
    assert drive(VehicleState(), VehicleCommand(1.0, 0.0), 0.4, actuation=dead).state.speed == pytest.approx(0.15)


def test_odometry_without_faults_is_the_truth():
    ideal = WheelErrors(slip=0.0, yaw_rate_scale=1.0, yaw_rate_bias=0.0, speed_noise=0.0, yaw_rate_noise=0.0)
    odometry, vehicle = WheelOdometry(0.02, 1, ideal), Vehicle(VehicleState(), PARAMS, INSTANT)
    for i in range(500):
        before = vehicle.state
        vehicle.step(VehicleCommand(1.0, 0.2 * math.sin(0.02 * i)), 0.01)
        after = vehicle.state
        odometry.step((before.speed + after.speed) / 2, (after.yaw - before.yaw) / 0.01, 0.01)
    np.testing.assert_allclose(odometry.pose, (after.x, after.y, after.yaw), atol=1e-9)


def test_odometry_is_wrong_by_what_its_parameters_say():
    wrong = WheelErrors(slip=0.02, yaw_rate_scale=1.0, yaw_rate_bias=0.001, speed_noise=0.05)
    odometry = WheelOdometry(0.02, 1, wrong)
    for _ in range(5000):
        odometry.step(1.0, 0.0, 0.01)
    # 50 m, 50 s; the noise of 2500 messages of 0.02 s adds 0.05 * 0.02 * sqrt(2500) = 0.05 m
    assert odometry.way == pytest.approx(50.0 / 0.98, abs=0.2)
    assert odometry.pose[2] == pytest.approx(0.05, abs=4 * 0.003 * 0.02 * 50)
    usual = WheelOdometry(0.02, 1, replace(WheelErrors(), speed_noise=0.0, yaw_rate_noise=0.0))
    for _ in range(1000):
        usual.step(1.0, 0.2, 0.01)
    assert (usual.way, usual.pose[2]) == (pytest.approx(10.0 / 0.995), pytest.approx(2.0 * 1.01 + 0.005))
    assert np.all(odometry.deviations[[0, 1, 5]] > WheelOdometry(0.02, 1, wrong).deviations[[0, 1, 5]])
