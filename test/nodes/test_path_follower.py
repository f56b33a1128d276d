"""The node path_follower: every pose answered, stops, calls and refusals on an offline bus."""

from dataclasses import replace

import numpy as np
import pytest
from sphere_nav_msgs.srv import LoadTrajectory

from path_follower.ros.node import PathFollowerNode
from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import se3_to_odometry, stamp_ns
from worlds.offline_follower import SECOND, drive, follower_bus, last, pose, speeds, status

COVARIANCE = 1e-4 * np.eye(6)


@pytest.fixture
def driving():
    """A bus, its node, and where the vehicle is, at full speed."""
    bus, node = follower_bus()
    return bus, node, drive(bus, node, 30)


def image(bus, state, x, y=0.0):
    """Let an image come a tenth of a second later, with a pose where the localiser has one; return what was said."""
    said = list(bus.advance(bus.now_ns + SECOND // 10))
    status(bus, state, bus.now_ns)
    if state == "TRACKING":
        pose(bus, x, bus.now_ns, y)
    return said + list(bus.settle())


def test_errors_are_published_while_driving():
    bus, node = follower_bus()
    x = drive(bus, node, 8, y=0.2)
    error = last(image(bus, "TRACKING", x, 0.2), "/tracking_error")
    assert error.cross_track == pytest.approx(0.2, abs=0.01)
    assert error.progress == pytest.approx(x, abs=0.1)
    assert error.reference.speed == pytest.approx(1.4)


def test_a_lost_image_is_answered_too_and_stops_within_half_a_second(driving):
    bus, node, x = driving
    for _ in range(5):
        said = image(bus, "LOST", x)
        assert stamp_ns(last(said, "/cmd_vel")) >= bus.now_ns
    assert last(said, "/cmd_vel").twist.linear.x == 0.0
    told = last(said, "/path_follower/status")
    assert (told.state, told.reason) == ("STOPPED", "NOT_LOCALISED")
    assert "start" in told.remedy
    for _ in range(10):
        assert set(speeds(image(bus, "TRACKING", x))) == {0.0}
    assert node.endpoints.call("start").success


def test_without_poses_the_node_keeps_commanding_and_stops(driving):
    bus = driving[0]
    said = list(bus.advance(bus.now_ns + 2 * SECOND))
    assert len(speeds(said)) == pytest.approx(75, abs=3)  # every 25 ms, once 0.12 s have passed
    assert speeds(said)[-1] == 0.0
    assert last(said, "/path_follower/status").reason == "POSE_TIMEOUT"


def test_a_pose_of_another_frame_is_refused_and_stops(driving):
    bus, node, x = driving
    pose(bus, x, bus.now_ns + SECOND // 20, frame="odom")
    said = list(bus.advance(bus.now_ns + SECOND))
    assert last(said, "/path_follower/status").reason == "BAD_POSE"
    wanted = next(entry for entry in node.inputs if entry.topic == "pose")
    assert wanted.last_refusal == "pose: header.frame_id: expected 'map', found 'odom'"


def test_trajectories_are_loaded_and_shown(tmp_path):
    bus, node = follower_bus()
    (tmp_path / "path.csv").write_text("0,0\n5,0\n10,0\n")
    answer = node.endpoints.call("load_trajectory", LoadTrajectory.Request(path=str(tmp_path / "path.csv")))
    assert (answer.success, answer.length) == (True, pytest.approx(10.0))
    assert last(list(bus.settle()), "/path_follower/trajectory").length == pytest.approx(10.0)
    answer = node.endpoints.call("load_trajectory", LoadTrajectory.Request(path=str(tmp_path / "none.csv")))
    assert (answer.success, "none.csv" in answer.message) == (False, True)
    assert node.loop.follower.path.length == pytest.approx(10.0)


def test_odometry_can_be_the_source_and_brings_the_speed():
    bus, node = follower_bus(source="odometry")
    T_map_base = SE3.from_angles(0.1, -0.2, 0.0, [1.0, 0.0, 0.0])
    message = se3_to_odometry(T_map_base, COVARIANCE, SECOND, ("map", "base_link"), [0.7, 0, 0, 0, 0, 0])
    bus.deliver("/odometry", message)
    watch = node.loop.follower.watch
    np.testing.assert_allclose(watch.T_map_base.matrix, T_map_base.matrix, atol=1e-12)
    assert watch.speed == pytest.approx(0.7)
    bus.deliver("/odometry", se3_to_odometry(SE3.identity(), COVARIANCE, 2 * SECOND, ("odom", "base_link")))
    assert watch.pose.x == 1.0


def test_before_anything_is_heard_the_node_tells_its_status_and_commands_nothing():
    bus = OfflineBus()
    bus.add(PathFollowerNode)
    said = [*bus.advance(SECOND), *bus.advance(2 * SECOND)]
    assert last(said, "/path_follower/status").state == "NO_PATH"
    assert not [item for item in said if item.topic == "/cmd_vel"]


def test_a_command_between_poses_carries_the_stamp_of_the_last_one(driving):
    bus, now = driving[0], driving[0].now_ns
    said = list(bus.advance(now + SECOND // 4))
    assert {stamp_ns(item.message) for item in said if item.topic == "/cmd_vel"} == {now}
    assert stamp_ns(last(list(bus.advance(now + SECOND)), "/cmd_vel")) > now + SECOND // 2


def test_deactivation_leaves_a_zero_command(driving):
    bus, node, _ = driving
    node.deactivate()
    assert last(list(bus.settle()), "/cmd_vel").twist.linear.x == 0.0


def test_cruise_speed_and_limits_change_while_driving(driving):
    bus, node, x = driving
    for cruise in (0.5, 1.8):
        node.tune(replace(node.params, speed=replace(node.params.speed, cruise=cruise)))
        x = drive(bus, node, 25, x)
        assert node.loop.follower.limiter.last.speed == pytest.approx(cruise, abs=0.1)
    node.tune(replace(node.params, safety=replace(node.params.safety, max_distance=0.1)))
    said = image(bus, "TRACKING", x, 0.2)  # a correction that is no jump
    assert last(said, "/path_follower/status").reason == "OFF_PATH"
