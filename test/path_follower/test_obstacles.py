"""The footprint that the vehicle sweeps until it could stand, and the points in it."""

import math

import numpy as np
import pytest

from path_follower.constants import ACROSS
from path_follower.obstacles import points_in_way, stopping_distance, swept_places
from path_follower.params import FollowerParams, VehicleParams
from path_follower.path import Pose2
from path_follower.vehicle import Motion

PARAMS = FollowerParams(vehicle=VehicleParams(max_acceleration=0.7, max_deceleration=1.1))
HALF = PARAMS.vehicle.width / 2 + PARAMS.safety.obstacle_margin
HERE = Pose2(10, 0, 0)
FRONT = PARAMS.vehicle.front + PARAMS.safety.obstacle_margin


@pytest.fixture
def straight(kit):
    return kit.make_path([(0, 0), (40, 0)], PARAMS)


def count(path, points, pose=HERE, distance=2.0):
    location = path.advance(pose, path.locate(pose), 1.0)
    return points_in_way(np.array(points, dtype=float), pose, path, location, distance, PARAMS)


def test_a_vehicle_stops_for_what_stands_in_its_way_not_for_what_is_beyond_behind_or_of_its_own_body(straight):
    assert count(straight, [(FRONT + 1.9, 0.0)]) == 1
    assert count(straight, [(FRONT + 2.3, 0.0)]) == 0
    assert count(straight, [(2.0, HALF - 0.02), (2.0, HALF + 0.02), (2.0, -HALF + 0.02)]) == 2
    assert count(straight, [(1.5, 0.0), (-0.3, 0.5), (-1.0, 0.0)]) == 0


def test_a_vehicle_in_a_bend_stops_for_what_stands_in_the_bend(kit):
    ring = kit.course((20, 1 / 5))
    path = kit.make_path(ring[:, :2], PARAMS, ring[:, 2])
    pose = Pose2(*ring[100])
    inside, outside = [(3.5, 2.0)], [(4.8, -1.0)]  # 4.8 m straight ahead the vehicle never comes
    assert count(path, inside, pose, 3.0) == 1
    assert count(path, outside, pose, 3.0) == 0


def test_an_offset_from_the_path_moves_the_footprint_with_the_vehicle(straight):
    beside = Pose2(10, 0.5, 0)
    assert count(straight, [(3.0, 0.6)], beside) == 1
    assert count(straight, [(3.0, -0.8)], beside) == 0  # on the path, but not where the vehicle goes


@pytest.mark.parametrize("turned", [0.4, -0.4])
def test_a_car_turned_against_the_path_meets_what_stands_along_the_path_and_not_before_its_nose(straight, turned):
    pose, way = Pose2(10, 0, turned), FRONT + 1.2
    ahead, before_the_nose = (way * np.array([math.cos(a), math.sin(a)]) for a in (-turned, turned))
    assert count(straight, [ahead], pose) == 1
    assert count(straight, [before_the_nose], pose) == 0


@pytest.mark.parametrize("turned", [0.4, -0.4])
def test_backwards_a_turned_car_sweeps_to_the_side_of_the_path_behind_it(kit, turned):
    back = kit.course((-20, 0))
    path = kit.make_path(back[:, :2], PARAMS, back[:, 2])
    way = -(PARAMS.vehicle.rear + PARAMS.safety.obstacle_margin + 1.2)
    behind, mirrored = (way * np.array([math.cos(a), math.sin(a)]) for a in (-turned, turned))
    assert count(path, [behind], Pose2(-5, 0, turned)) == 1
    assert count(path, [mirrored], Pose2(-5, 0, turned)) == 0


def test_a_vehicle_needs_reaction_braking_and_one_step_to_stand():
    assert stopping_distance(2.0, PARAMS) == pytest.approx(2.0 * 0.3 + 2.0**2 / (2 * 1.1) + 0.2)
    assert stopping_distance(-1.0, PARAMS) == pytest.approx(1.0 * 0.3 + 1.0 / (2 * 1.1) + 0.2)


def test_a_scanner_has_to_see_the_way_ahead_as_wide_and_far_as_it_is_driven():
    for speed, angle in [(1.4, 0.0), (1.4, 0.3), (-1.0, 0.0), (0.0, 0.0), (-0.0, 0.0)]:
        places = swept_places(Motion(speed, angle), PARAMS)
        sign = math.copysign(1.0, speed)
        end = PARAMS.vehicle.front if sign > 0 else -PARAMS.vehicle.rear
        reach = stopping_distance(PARAMS.speed.cruise, PARAMS)
        along = sign * (places[:, 0] - end)
        assert len(places) % ACROSS == 0
        if angle == 0.0:
            assert (along.min(), along.max()) == pytest.approx((0.2, reach), abs=0.2)
            assert np.unique(np.abs(places[:, 1]).round(6))[[0, -1]].tolist() == pytest.approx([0.0, HALF])
        else:
            assert places[:, 1].max() > HALF + 0.1  # the way bends to the left
            assert places[:, 1].min() > -HALF
