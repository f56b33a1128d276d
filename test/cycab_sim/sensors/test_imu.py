import math
from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.params import ImuParams, SimCameraParams
from cycab_sim.sensors.imu import Imu, ImuErrors
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from sphere_nav.geometry import SE3

GRAVITY = 9.80665

STEP = 10_000_000
NO_ERRORS = ImuErrors(
    acceleration_noise=0.0, acceleration_bias=0.0, acceleration_walk=0.0,
    rate_noise=0.0, rate_bias=0.0, rate_walk=0.0, orientation_noise_deg=0.0,
)  # fmt: skip


def make(small_params, errors, along=0.0, **changes):
    params = replace(small_params, imu=ImuParams(is_on=True), camera=SimCameraParams(period=0.0), **changes)
    simulator = Simulator(params)
    simulator.imu = Imu(params.imu, params.noise_seed, errors)
    simulator.teleport(*simulator.path.at(along)[:3])
    return simulator


def drive(simulator, steps, command):
    readings = []
    for _ in range(steps):
        simulator.step(command, STEP)
        simulator.take_due()
        readings.append(simulator.read_imu())
    return readings


def test_a_leaning_car_feels_turn_and_pull_along_its_own_axes():
    imu, pose = Imu(ImuParams(), 3, NO_ERRORS), SE3.exp(np.array([0.0, 0.0, 0.0, 0.0, -0.2, 0.0]))
    for _ in range(3):
        before, pose = pose, pose @ SE3.exp(0.01 * np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.3]))
        imu.step(before, pose, 0.01)
    reading = imu.read(pose, 0)
    np.testing.assert_allclose(reading.angular_rate, [0.0, 0.0, 0.3], atol=1e-9)
    turn, arm = np.array([0.0, 0.0, 0.3]), imu.T_base_imu.translation
    pull = np.cross(turn, np.array([1.5, 0.0, 0.0]) + np.cross(turn, arm))  # of half a step earlier in heading
    expected = before.rotation.T @ [0.0, 0.0, GRAVITY] + pull
    np.testing.assert_allclose(reading.acceleration, expected, atol=3e-3)


def test_on_the_ramp_gravity_and_orientation_show_the_pitch(small_params):
    simulator = make(small_params, NO_ERRORS, world="ramp", along=35.0)
    reading = drive(simulator, 3, VehicleCommand())[-1]
    slope = math.atan(0.08)
    expected = [GRAVITY * math.sin(slope), 0.0, GRAVITY * math.cos(slope)]
    np.testing.assert_allclose(reading.acceleration, expected, atol=1e-3)
    assert reading.T_world_imu.rotation[2, 0] == pytest.approx(math.sin(slope), abs=1e-4)  # nose up


def test_being_put_elsewhere_is_not_an_acceleration(small_params):
    simulator = make(small_params, NO_ERRORS)
    drive(simulator, 5, VehicleCommand(1.0))
    simulator.teleport(20.0, -0.5, 1.0, 2.0)
    reading = drive(simulator, 1, VehicleCommand(2.0))[-1]
    assert np.linalg.norm(reading.acceleration) == pytest.approx(GRAVITY, abs=0.01)


def test_noise_and_bias_have_the_sizes_asked_for():
    errors = replace(NO_ERRORS, orientation_noise_deg=1.0, rate_noise=0.004)
    errors = replace(errors, acceleration_noise=0.05, acceleration_bias=0.3)
    still = SE3.from_planar(0.0, 0.0, 0.5)
    imu = Imu(ImuParams(), 3, errors)
    imu.step(still, still, 0.01)
    readings = [imu.read(still, i) for i in range(2000)]
    force = np.array([reading.acceleration for reading in readings])
    rate = np.array([reading.angular_rate for reading in readings])
    assert force.std(axis=0) == pytest.approx([0.05] * 3, rel=0.08)  # 5 sigma of 2000 draws
    assert rate.std(axis=0) == pytest.approx([0.004] * 3, rel=0.08)
    tilts = [(still.inverse() @ reading.T_world_imu).log()[3:] for reading in readings]
    assert np.std(tilts, axis=0) == pytest.approx([math.radians(1.0)] * 3, rel=0.08)
    offsets = []
    for seed in range(200):
        imu = Imu(ImuParams(), seed, errors)
        imu.step(still, still, 0.01)
        offsets.append(imu.read(still, 0).acceleration - [0, 0, GRAVITY])
    assert np.std(offsets) == pytest.approx(math.hypot(0.3, 0.05), rel=0.15)  # 5 sigma of 600 draws
