import numpy as np
import pytest
from scipy.spatial import cKDTree

from cycab_sim.driver import PurePursuitDriver
from cycab_sim.params import ActuatorParams, CarParams, TeachParams
from cycab_sim.vehicle import Vehicle, VehicleState
from cycab_sim.world.town import draw_plan, taught_path

STEP = 0.04  # s


def test_the_driver_stays_on_the_path_is_gentle_and_stops_at_its_end():
    params, path = TeachParams(), taught_path(draw_plan(3), "two_turns")
    driver = PurePursuitDriver(path, params, 1)
    x, y, yaw, _ = path.at(np.array(0.0))
    vehicle = Vehicle(VehicleState(x, y, yaw), CarParams(), ActuatorParams())
    states = [vehicle.state]
    while not (driver.is_done and vehicle.state.speed < 1e-3):
        vehicle.step(driver.command(vehicle.state), STEP)
        states.append(vehicle.state)
        assert len(states) < 20000
    points = path.at(np.arange(0.0, path.length, 0.005))[:, :2]
    offsets, _ = cKDTree(points).query([(state.x, state.y) for state in states[::3]])
    # what it wanders, and the cutting of corners by its look-ahead: 1.2^2 / (8 * 5 m) = 0.04 m
    assert max(offsets) < 0.05 + 0.06
    assert np.mean(offsets) > 0.005  # a human, not a rail
    end = path.at(np.array(path.length))
    assert np.hypot(states[-1].x - end[0], states[-1].y - end[1]) < 0.15
    speed = np.array([state.speed for state in states])
    yaw_rate = np.diff([state.yaw for state in states]) / STEP
    change = np.diff(speed) / STEP
    assert speed.max() == pytest.approx(params.speed, abs=0.02)
    assert np.abs(change).max() < 1.5  # the last decimetre, where the brakes lag behind the driver; else a third of it
    assert np.abs(yaw_rate * speed[1:]).max() < 1.5 * params.lateral_acceleration
    assert speed[:-1].min() >= 0.0
