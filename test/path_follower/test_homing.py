"""Driving by direction alone: it turns to where it is told, and stops when it is not told, or not clearly."""

import math
from dataclasses import replace

import numpy as np
import pytest

from path_follower.homing import HomingFollower
from path_follower.obstacles import points_on_arc
from path_follower.params import FollowerParams, HomingParams
from path_follower.path import Pose2
from path_follower.reasons import StopReason
from path_follower.vehicle import Motion, drive

SECOND = 1_000_000_000
STEP = SECOND // 10
PARAMS = FollowerParams()


class Car:
    """An ideal car, and a source that points to a place."""

    def __init__(self, goal=(8.0, 3.0), **homing):
        self.pose, self.goal, self.now = Pose2(0.0, 0.0, 0.0), goal, SECOND
        self.follower = HomingFollower(replace(PARAMS, homing=HomingParams(**homing)))
        self.command = None

    def direction(self):
        angle = math.atan2(self.goal[1] - self.pose.y, self.goal[0] - self.pose.x) - self.pose.yaw
        return (angle + math.pi) % (2 * math.pi) - math.pi

    @property
    def left(self):
        return math.hypot(self.goal[0] - self.pose.x, self.goal[1] - self.pose.y)

    def step(self, *, is_trusted=True, is_silent=False):
        self.now += STEP
        if not is_silent:
            is_there = self.left < 0.5
            way = (1.0, self.left)
            self.follower.see_source(is_trusted=is_trusted, is_there=is_there, way=way, now_ns=self.now)
            if is_trusted:
                self.follower.see(self.direction(), self.now)
        self.command = self.follower.tick(self.now)
        motion = Motion(self.command.speed, self.command.steering_angle)
        self.pose = drive(self.pose, motion, PARAMS.vehicle.wheelbase, STEP / SECOND)
        return self.command

    def begin(self):
        self.step()
        assert self.follower.start(self.now) == ""
        return self


@pytest.mark.parametrize("goal", [(8.0, 0.0), (8.0, 3.0), (9.0, -5.0)])
def test_a_homing_car_drives_to_where_it_is_told_and_stands_there(goal):
    car = Car(goal=goal).begin()
    speeds = [car.step().speed for _ in range(400)]
    assert car.left < 0.7  # it is there within 0.5 m, and brakes on
    assert car.command.status.state == "FINISHED"
    assert car.command.status.verdict.reason is StopReason.END_OF_PATH
    assert car.follower.start(car.now).startswith("END_OF_PATH")
    assert max(speeds) <= HomingParams().speed + 1e-9
    assert car.command.speed == 0.0


def test_a_late_direction_is_less_by_as_much_as_the_car_has_turned_since():
    """By the yaw rate of the last command, for half a second at most."""
    for later_s, counted_s in [(0.0, 0.0), (0.2, 0.2), (0.45, 0.45), (3.0, 0.5)]:
        car = Car(goal=(4.0, 4.0)).begin()
        for _ in range(10):
            car.step()
        told, follower = car.follower.direction, car.follower
        yaw_rate = follower.limiter.last.yaw_rate(PARAMS.vehicle.virtual_wheelbase)
        _, curvature = follower._law(car.now + round(later_s * SECOND), None)
        assert yaw_rate > 0.1
        assert curvature == pytest.approx(2.0 * math.sin(told - yaw_rate * counted_s) / HomingParams().look_ahead)


def test_a_source_that_falls_silent_stops_the_car_within_half_a_second():
    car = Car().begin()
    for _ in range(30):
        car.step()
    assert car.command.speed > 0.3
    speeds = [car.step(is_silent=True).speed for _ in range(7)]
    assert speeds[-1] == 0.0
    assert speeds[-2] == 0.0  # 0.4 s of silence, 0.6 m/s at 4 m/s^2
    assert car.command.status.verdict.reason is StopReason.POSE_TIMEOUT
    car.step()
    assert car.command.speed == 0.0  # a direction alone does not set it in motion again
    assert car.follower.start(car.now) == ""


def test_unclear_directions_slow_the_car_and_soon_stop_it():
    car = Car(speed=1.0).begin()
    for _ in range(30):
        car.step()
    speeds = [car.step(is_trusted=False).speed for _ in range(8)]  # 0.35 s, then 4 m/s^2
    assert 0.0 < speeds[2] < 0.95 * speeds[0]
    assert speeds[-2:] == [0.0, 0.0]
    assert (car.command.speed, car.command.status.verdict.reason) == (0.0, StopReason.NOT_LOCALISED)


def test_a_direction_too_wide_is_refused_to_both_sides():
    for angle, is_drivable in [(1.1, True), (1.3, False), (-1.1, True), (-1.3, False)]:
        follower = HomingFollower(PARAMS)
        follower.see_source(is_trusted=True, is_there=False, way=(1.0, 5.0), now_ns=SECOND)
        follower.see(angle, SECOND)
        refusal = follower.start(SECOND)
        assert refusal == "" if is_drivable else refusal.startswith("OFF_PATH: found 1.3, limit 1.2")


def test_an_obstacle_on_the_arc_stops_the_car_and_one_beside_it_does_not():
    ahead = np.array([[2.2, 0.0], [2.2, 0.1], [2.2, -0.1]])
    car = Car(goal=(20.0, 0.0)).begin()
    for _ in range(30):
        car.step()
    car.follower.watch.see_scan(ahead + np.array([0.0, 3.0]), car.now)
    assert car.step().speed > 0.3
    car.follower.watch.see_scan(ahead, car.now)
    for _ in range(4):
        car.step()
    assert (car.command.speed, car.command.status.verdict.reason) == (0.0, StopReason.OBSTACLE)
    beside = np.array([[3.0, 1.6], [3.0, 1.7]])
    assert points_on_arc(beside, 0.0, 3.0, PARAMS) == 0
    assert points_on_arc(beside, 0.4, 3.0, PARAMS) == 2  # the wheel is turned towards them


def test_a_path_is_not_for_this_follower():
    with pytest.raises(ValueError, match="give it to mcl_depth"):
        HomingFollower(PARAMS).load(None)
