"""The node path_follower: every pose answered, stops, calls and refusals on an offline bus."""

import math

import numpy as np
import pytest
from sphere_nav_msgs.srv import LoadTrajectory

from path_follower.params import PathFollowerParams
from path_follower.ros.node import PathFollowerNode
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.params import build
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import (
    poses_to_path,
    se3_to_odometry,
    se3_to_pose_with_covariance,
    stamp_ns,
    status_to_message,
)

SECOND = 1_000_000_000
STEP = SECOND // 20
COVARIANCE = 1e-4 * np.eye(6)


def straight():
    return poses_to_path([(0, SE3.from_planar(x, 0, 0)) for x in np.arange(0, 20, 0.1)], SECOND, "map")


def pose_message(x, y, yaw, stamp, frame="map"):
    return se3_to_pose_with_covariance(SE3.from_planar(x, y, yaw), COVARIANCE, stamp, frame)


class Bench:
    def __init__(self, **values):
        self.bus = OfflineBus()
        self.node = self.bus.add(PathFollowerNode, {"enable_stamped_cmd_vel": True} | values)
        self.now, self.x, self.y, self.yaw = SECOND, 0.0, 0.0, 0.0

    def send(self, *messages):
        for topic, message in messages:
            self.bus.publish(topic, message)
        return list(self.bus.settle())

    def call(self, name, request=None):
        return self.node.endpoints.call(name, request)

    def step(self, state="TRACKING"):
        """One image: status, and a pose where the localiser has one; returns what the node said."""
        self.now += STEP
        said = list(self.bus.advance(self.now))
        said += self.send(("/status", status_to_message(Status(State(state)), self.now, "map")))
        if state == "TRACKING":
            said += self.send(("/pose", pose_message(self.x, self.y, self.yaw, self.now)))
        commands = [record.message for record in said if record.topic == "/cmd_vel"]
        assert commands, "every image is answered"
        assert stamp_ns(commands[-1]) >= self.now
        self.x += commands[-1].twist.linear.x * STEP / SECOND * math.cos(self.yaw)
        self.y += commands[-1].twist.linear.x * STEP / SECOND * math.sin(self.yaw)
        self.yaw += commands[-1].twist.angular.z * STEP / SECOND
        return said

    def last(self, said, topic):
        return [record.message for record in said if record.topic == topic][-1]


@pytest.fixture
def bench():
    bench = Bench()
    bench.send(("/reference_path", straight()))
    bench.step()
    return bench


def drive_until(bench, x):
    assert bench.call("start").success
    for _ in range(1000):
        bench.step()
        if bench.x > x:
            return
    raise AssertionError(f"expected to pass {x} m, found {bench.x:.2f}")


def test_errors_are_published_while_driving(bench):
    bench.y = 0.2
    drive_until(bench, 0.5)
    error = bench.last(bench.step(), "/tracking_error")
    assert 0.05 < error.cross_track < 0.25
    assert error.progress == pytest.approx(bench.x, abs=0.1)
    assert error.reference.speed == pytest.approx(1.4)


def test_a_lost_image_is_answered_too_and_stops_within_half_a_second(bench):
    drive_until(bench, 3.0)
    for _ in range(10):
        said = bench.step("LOST")
    assert bench.last(said, "/cmd_vel").twist.linear.x == 0.0
    status = bench.last(said, "/path_follower/status")
    assert (status.state, status.reason) == ("STOPPED", "NOT_LOCALISED")
    assert "start" in status.remedy
    for _ in range(10):
        assert bench.last(bench.step(), "/cmd_vel").twist.linear.x == 0.0
    assert bench.call("start").success


def test_without_poses_the_node_keeps_commanding_and_stops(bench):
    drive_until(bench, 3.0)
    said = list(bench.bus.advance(bench.now + 2 * SECOND))
    commands = [record for record in said if record.topic == "/cmd_vel"]
    assert len(commands) == pytest.approx(75, abs=3)  # every 25 ms, once 0.12 s have passed
    assert commands[-1].message.twist.linear.x == 0.0
    assert bench.last(said, "/path_follower/status").reason == "POSE_TIMEOUT"


def test_a_pose_of_another_frame_is_refused_and_stops(bench):
    drive_until(bench, 3.0)
    bench.now += STEP
    bench.send(("/pose", pose_message(3, 0, 0, bench.now, "odom")))
    said = list(bench.bus.advance(bench.now + SECOND))
    assert bench.last(said, "/path_follower/status").reason == "BAD_POSE"
    wanted = next(entry for entry in bench.node.inputs if entry.topic == "pose")
    assert wanted.last_refusal == "pose: header.frame_id: expected 'map', found 'odom'"


def test_trajectories_are_loaded_and_shown(bench, tmp_path):
    (tmp_path / "path.csv").write_text("0,0\n5,0\n10,0\n")
    answer = bench.call("load_trajectory", LoadTrajectory.Request(path=str(tmp_path / "path.csv")))
    assert answer.success
    assert answer.length == pytest.approx(10.0)
    assert bench.last(list(bench.bus.settle()), "/path_follower/trajectory").length == pytest.approx(10.0)
    answer = bench.call("load_trajectory", LoadTrajectory.Request(path=str(tmp_path / "none.csv")))
    assert not answer.success
    assert "none.csv" in answer.message
    assert bench.node.loop.follower.path.length == pytest.approx(10.0)


def test_odometry_can_be_the_source_and_brings_the_speed():
    bench = Bench(source="odometry")
    bench.send(("/reference_path", straight()))
    list(bench.bus.advance(SECOND))
    twist = np.array([0.7, 0, 0, 0, 0, 0])
    T_map_base = SE3.from_angles(0.1, -0.2, 0.0, [1.0, 0.0, 0.0])
    message = se3_to_odometry(T_map_base, COVARIANCE, SECOND, ("map", "base_link"), twist)
    bench.send(("/odometry", message))
    assert bench.node.loop.follower.watch.pose.x == 1.0
    np.testing.assert_allclose(bench.node.loop.follower.watch.T_map_base.matrix, T_map_base.matrix, atol=1e-12)
    assert bench.node.loop.follower.watch.speed == pytest.approx(0.7)
    bench.send(("/odometry", se3_to_odometry(SE3.identity(), COVARIANCE, 2 * SECOND, ("odom", "base_link"))))
    assert bench.node.loop.follower.watch.pose.x == 1.0


def test_before_anything_is_heard_the_node_tells_its_status_and_commands_nothing():
    bench = Bench()
    said = [*bench.bus.advance(SECOND), *bench.bus.advance(2 * SECOND)]
    assert bench.last(said, "/path_follower/status").state == "NO_PATH"
    assert not [record for record in said if record.topic == "/cmd_vel"]


def test_a_command_between_poses_carries_the_stamp_of_the_last_one(bench):
    drive_until(bench, 3.0)
    said = list(bench.bus.advance(bench.now + SECOND // 4))
    assert {stamp_ns(record.message) for record in said if record.topic == "/cmd_vel"} == {bench.now}
    said = list(bench.bus.advance(bench.now + SECOND))
    assert stamp_ns(bench.last(said, "/cmd_vel")) > bench.now + SECOND // 2


def test_deactivation_leaves_a_zero_command(bench):
    drive_until(bench, 3.0)
    bench.node.deactivate()
    assert bench.last(list(bench.bus.settle()), "/cmd_vel").twist.linear.x == 0.0


def test_cruise_speed_and_limits_change_while_driving(bench):
    drive_until(bench, 4.0)
    for cruise in (0.5, 1.8):
        bench.node.tune(build(PathFollowerParams, {"speed.cruise": cruise, "enable_stamped_cmd_vel": True}))
        for _ in range(50):
            said = bench.step()
        assert bench.last(said, "/cmd_vel").twist.linear.x == pytest.approx(cruise, abs=0.1)
    bench.node.tune(build(PathFollowerParams, {"safety.max_distance": 0.1, "enable_stamped_cmd_vel": True}))
    bench.y += 0.2  # a correction that is no jump
    said = bench.step()
    assert bench.last(said, "/path_follower/status").reason == "OFF_PATH"
