from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.simulator import Simulator
from cycab_sim.world.paths import Path, Piece, turn
from cycab_sim.world.worlds import GroundProfile, build_world
from sphere_nav.geometry import SE3


def test_the_ramp_rises_by_8_percent_and_the_car_with_it(small_params):
    ground = build_world("ramp", 3).ground
    assert float(ground.height(50.0) - ground.height(30.0)) / 20.0 == pytest.approx(0.08)
    simulator = Simulator(replace(small_params, world="ramp"))
    simulator.teleport(*simulator.path.at(35.0)[:3])
    T_world_base = simulator.T_world_base
    assert T_world_base.translation[2] == pytest.approx(0.08 * 15.0)
    ahead = T_world_base.rotation[:, 0]
    assert ahead[2] / ahead[0] == pytest.approx(0.08)
    frame = simulator.capture("sphere")
    straight_down = frame.range_m[-1].min()  # 1.8 m above the road, which is tilted as the car
    assert straight_down == pytest.approx(1.8, abs=0.03)


def test_wheels_stand_on_the_ground_when_it_is_crossed_at_an_angle():
    ground = GroundProfile((0.0, 100.0), (0.0, 8.0))
    planar = SE3.from_planar(50.0, 0.0, 0.7)
    T_world_base = ground.follow(planar, 1.2, 1.2)
    wheels = T_world_base.apply(np.array([[0.0, 0, 0], [1.2, 0, 0], [0, 0.6, 0], [0, -0.6, 0]]))
    np.testing.assert_allclose(wheels[:, 2], ground.height(wheels[:, 0]), atol=2e-3)  # second order in the slope
    assert GroundProfile().follow(planar, 1.2, 1.2) is planar


def test_a_path_turns_by_its_radius_and_goes_straight_on_beyond_its_ends():
    path = Path((1.0, 2.0, 0.0), (Piece(5.0), turn(4.0, 90)))
    before, corner, beyond = path.at(np.array([-1.0, 5.0, path.length + 2.0]))
    np.testing.assert_allclose(before, [0.0, 2.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(corner, [6.0, 2.0, 0.0, 0.25], atol=1e-12)
    np.testing.assert_allclose(beyond, [10.0, 8.0, np.pi / 2, 0.25], atol=1e-12)
