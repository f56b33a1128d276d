"""Directions along a path from the node: published, clear, and followed to the end by path_follower's homing."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mcl_depth import homing
from mcl_depth.params import MclDepthParams
from mcl_depth.ros.views import HomingGuide
from path_follower.path import Pose2
from path_follower.ros.node import PathFollowerNode
from path_follower.vehicle import Motion
from path_follower.vehicle import drive as driven
from sphere_nav.geometry import SE3
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


def path_message(frame="map"):
    return poses_to_path([(0, pose) for pose in PATH], SECOND, frame)


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


@pytest.mark.slow
def test_beside_a_waypoint_the_direction_leads_to_the_path_beyond_it(eye, cloud):
    bench = bench_of(eye, cloud)
    bench.send("/reference_path", path_message())
    waypoint = bench.node.guide.homing.waypoints[0]
    for _ in range(3):
        answer = bench.see(SE3.from_planar(waypoint[0] - 0.2, waypoint[1] - 0.5, 0.0))  # the eye is 0.2 m ahead
    direction = answer["/homing/direction"]
    assert direction.header.frame_id == "base_link"
    assert stamp_ns(direction) == bench.now
    yaw = float(pose_to_se3(direction.pose).yaw)
    beyond = math.atan2(0.5, 2 * 0.5)  # as far ahead as the samples reach; they are 22.5 degrees apart
    assert abs(yaw - beyond) < np.radians(20.0)
    status = answer["/homing/status"]
    assert (status.state, status.reason, status.is_armed) == ("DRIVING", "", True)
    assert (status.progress, status.distance_to_end > 3.0) == (0.0, True)


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
