"""Directions along a path from the node: published, clear, and followed to the end by path_follower's homing."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from mcl_depth import homing
from mcl_depth.params import MclDepthParams
from mcl_depth.ros.views import HomingGuide
from path_follower.path import Pose2
from path_follower.ros.node import PathFollowerNode
from path_follower.vehicle import Motion
from path_follower.vehicle import drive as driven
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.params import build
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import pose_to_se3, poses_to_path, stamp_ns
from sphere_nav.ros.node import ManagedNode
from worlds.mcl import SECOND, Bench, Eye, room_points

PATH = [SE3.from_planar(x, -1.0 + 0.1 * (x + 2.4) ** 2, 0.0) for x in np.arange(-2.6, 1.4, 0.2)]
EYE = np.array([0.2, 0.0])  # roughly: before the base
SETTINGS = {
    "homing.spacing": 0.8,
    "homing.distance_step": 0.5,
    "input.max_leap_s": 10.0,
    "input.min_way": 0.0,
    "input.allow_still": True,
}


@pytest.fixture(autouse=True)
def homing_in_a_room(monkeypatch):
    """Half the distances of the paper's streets, and an image every 0.3 m: fewer in the median."""
    monkeypatch.setattr(homing, "REACH", 0.8)
    monkeypatch.setattr(homing, "NUM_MEDIAN", 3)


@pytest.fixture(scope="module")
def eye():
    return Eye(is_lit=True)


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "room.npy"
    np.save(path, room_points())
    return path


def path_message():
    return poses_to_path([(0, pose) for pose in PATH], SECOND, "map")


def bench_of(eye, cloud, **more):
    return Bench(eye, cloud, **{name.replace(".", "__"): value for name, value in (SETTINGS | more).items()})


def test_the_same_path_again_goes_on_and_another_one_begins():
    bus = OfflineBus()
    guide = HomingGuide(bus.add(ManagedNode).endpoints, MclDepthParams())
    bus.deliver("/reference_path", path_message())
    homing = guide.homing
    assert np.linalg.norm(homing.waypoints[[0, -1]] - [PATH[k].translation[:2] for k in (0, -1)], axis=1).max() < 1e-9
    bus.deliver("/reference_path", path_message())
    assert guide.homing is homing
    bus.deliver("/reference_path", poses_to_path([(0, pose) for pose in PATH[2:]], SECOND, "map"))
    assert guide.homing is not homing


class Alike(NamedTuple):
    """A comparison that knows where the vehicle stands and heads."""

    place: np.ndarray
    yaw: float

    def curves(self, samples):
        near = np.exp(-np.linalg.norm(samples - self.place, axis=1))
        return near[:, None] * (2.0 + np.cos(2.0 * np.pi * np.arange(72) / 72 - self.yaw))


def test_the_direction_leads_to_the_path_beyond_the_next_waypoint_and_from_there_to_the_end():
    bus = OfflineBus()
    guide = HomingGuide(bus.add(ManagedNode).endpoints, build(MclDepthParams, SETTINGS))
    bus.deliver("/reference_path", path_message())

    def see(place, yaw):
        guide.answer(SimpleNamespace(comparison=Alike(place, yaw)), Status(State.TRACKING), SECOND)
        said = {one.topic: one.message for one in bus.settle()}
        return said["/homing/direction"], said["/homing/status"]

    waypoints = guide.homing.waypoints
    length = np.linalg.norm(np.diff(waypoints, axis=0), axis=1).sum()
    direction, status = see(waypoints[0] - 0.5 * np.sqrt(0.5), 0.3)  # behind and to the right
    assert (direction.header.frame_id, stamp_ns(direction)) == ("base_link", SECOND)
    ahead = (waypoints[1] - waypoints[0]) / np.linalg.norm(waypoints[1] - waypoints[0])
    x, y = 0.5 * np.sqrt(0.5) + 2 * 0.5 * ahead  # as far as the samples reach
    assert float(pose_to_se3(direction.pose).yaw) == pytest.approx(math.atan2(y, x) - 0.3, abs=0.01)
    assert (status.state, status.reason, status.is_armed) == ("DRIVING", "", True)
    for number, waypoint in enumerate(waypoints):
        for _ in range(2):  # images in a row
            assert (status.state, guide.homing.next) == ("DRIVING", number)
            assert status.progress + status.distance_to_end == pytest.approx(length)
            assert status.progress == pytest.approx(length * max(number - 1, 0) / (len(waypoints) - 1), rel=0.01)
            _, status = see(waypoint, 0.0)
    assert (status.state, status.progress, status.distance_to_end) == ("FINISHED", pytest.approx(length), 0.0)


@pytest.mark.slow
def test_an_image_that_cannot_be_used_gives_no_direction(eye, cloud):
    bench = bench_of(eye, cloud)
    bench.send("/reference_path", path_message())
    assert "/homing/direction" in bench.see(PATH[0])
    bench.eye = Dark(eye)
    answer = bench.see(PATH[0])
    assert "/homing/direction" not in answer
    assert (answer["/homing/status"].state, answer["/homing/status"].reason) == ("STOPPED", "NOT_LOCALISED")


class Dark:
    """A camera with its cap on."""

    def __init__(self, eye):
        self.camera = eye.camera

    def picture(self, _):
        return np.zeros((self.camera.height, self.camera.width), np.uint8)


@pytest.mark.slow
def test_the_path_is_followed_to_its_end_by_directions_alone(eye, cloud):
    bench = bench_of(eye, cloud)
    bench.bus.add(PathFollowerNode, {"source": "homing", "enable_stamped_cmd_vel": True} | FOLLOWER)
    follower = bench.bus.nodes[-1]
    bench.send("/reference_path", path_message())
    pose = Pose2(-2.8, -1.1, 0.1)
    states, trail = [], []
    for number in range(120):
        said = bench.see(SE3.from_planar(*pose), T_odom_base=None)
        command = said["/cmd_vel"].twist
        if number == 2:
            assert follower.endpoints.call("start").success
        states.append(said["/path_follower/status"].state)
        trail.append((pose.x, pose.y))
        if states[-1] == "FINISHED":
            break
        speed, rate = command.linear.x, command.angular.z
        angle = math.atan2(rate * 1.2, speed) if speed > 0 else 0.0
        for _ in range(2):
            pose = driven(pose, Motion(speed, angle), 1.2, 0.25)
    assert states[-1] == "FINISHED", (states[-5:], trail[-5:], said["/path_follower/status"])
    assert "STOPPED" not in states
    end = np.array(trail[-1]) + EYE  # the eye follows the path
    assert np.linalg.norm(end - PATH[-1].translation[:2]) < 1.0
    xy = np.array([item.translation[:2] for item in PATH])
    off = [np.min(np.linalg.norm(xy - (np.array(place) + EYE), axis=1)) for place in trail]
    assert max(off) < 0.8  # samples are 0.5 m apart


FOLLOWER = {
    "homing.speed": 0.4,
    "homing.look_ahead": 1.2,
    "safety.max_pose_silence": 2.5,
    "safety.max_blind_time": 1.5,
    "vehicle.max_acceleration": 5.0,
    "vehicle.max_steering_rate": 3.0,
}
