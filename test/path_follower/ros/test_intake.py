"""What the follower is driven by: poses, or directions whose frame and source are checked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from sphere_nav_msgs.msg import FollowerStatus

from path_follower.ros.intake import DirectionIntake
from path_follower.ros.node import PathFollowerNode
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import (
    header,
    poses_to_path,
    se3_to_pose_stamped,
    se3_to_pose_with_covariance,
    status_to_message,
)

SECOND = 10**9


@pytest.fixture
def bus():
    bus = OfflineBus()
    bus.add(PathFollowerNode, {"source": "homing", "enable_stamped_cmd_vel": True})
    return bus


def direction(bus, angle, stamp, frame="base_link"):
    list(bus.advance(stamp))
    bus.deliver("/homing/direction", se3_to_pose_stamped(SE3.from_planar(0.0, 0.0, angle), stamp, frame))
    return list(bus.settle())


def source(bus, state, stamp, **values):
    list(bus.advance(stamp))
    bus.deliver("/homing/status", FollowerStatus(header=header(stamp, "map"), state=state, **values))
    return list(bus.settle())


def test_every_direction_is_answered_by_a_command_with_its_stamp(bus):
    node = bus.nodes[0]
    assert isinstance(node.loop.intake, DirectionIntake)
    source(bus, "DRIVING", SECOND, progress=1.0, distance_to_end=4.0)
    assert not node.shell.call("start").success  # no direction yet
    direction(bus, 0.2, SECOND)
    assert node.shell.call("start").success
    for stamp in (SECOND + SECOND // 10, SECOND + SECOND // 5):
        said = {record.topic: record.message for record in direction(bus, 0.2, stamp)}
    assert said["/cmd_vel"].header.stamp.nanosec == SECOND // 5
    assert said["/cmd_vel"].twist.linear.x > 0.0
    assert said["/path_follower/status"].distance_to_end == 4.0


def test_a_source_in_doubt_is_answered_at_once(bus):
    source(bus, "DRIVING", SECOND)
    direction(bus, 0.0, SECOND)
    assert bus.nodes[0].shell.call("start").success
    said = {record.topic: record.message for record in source(bus, "STOPPED", SECOND + SECOND // 10)}
    assert said["/path_follower/status"].reason == "NOT_LOCALISED"


def test_a_direction_of_another_frame_is_refused(bus):
    direction(bus, 0.0, SECOND, "map")
    told = next(item for item in bus.nodes[0].inputs if item.topic == "homing/direction")
    assert "header.frame_id: expected 'base_link', found 'map'" in told.last_refusal
    assert bus.nodes[0].loop.follower.direction is None


def test_numbers_that_are_none_are_refused(bus):
    source(bus, "DRIVING", SECOND, progress=float("nan"))
    told = next(item for item in bus.nodes[0].inputs if item.topic == "homing/status")
    assert "expected finite lengths" in told.last_refusal


def test_poses_are_not_listened_to_while_homing(bus):
    bus.deliver("/pose", se3_to_pose_with_covariance(SE3.identity(), np.eye(6), SECOND, "map"))
    assert list(bus.settle()) == []


# --- stamps
AHEAD = [11 * 10**7, SECOND, 3600 * SECOND, 2**31 * SECOND - 10 * SECOND]


def follower_bus(**values):
    bus = OfflineBus()
    node = bus.add(PathFollowerNode, {"enable_stamped_cmd_vel": True} | values)
    points = [(0, SE3.from_planar(x, 0, 0)) for x in np.arange(0, 50, 0.5)]
    list(bus.advance(SECOND))
    bus.deliver("/reference_path", poses_to_path(points, SECOND, "map"))
    return bus, node


def pose(bus, x, stamp):
    bus.deliver("/pose", se3_to_pose_with_covariance(SE3.from_planar(x, 0, 0), 1e-4 * np.eye(6), stamp, "map"))


def status(bus, state, stamp, reason="", age=0.0):
    bus.deliver("/status", status_to_message(Status(State(state), reason, age=age), stamp, "map"))


def speeds(bus):
    return [item.message.twist.linear.x for item in bus if item.topic == "/cmd_vel"]


def drive(bus, node, images, period=SECOND // 10, x=0.0):
    """Drive at full speed on good poses; return where the vehicle is."""
    for k in range(images):
        list(bus.advance(bus.now_ns + period))
        status(bus, "TRACKING", bus.now_ns)
        pose(bus, x, bus.now_ns)
        commands = speeds(bus.settle())
        x += commands[-1] * period / SECOND
        if k == 2:
            assert node.shell.call("start").success
    return x


@pytest.mark.parametrize("lead", AHEAD)
def test_a_pose_from_the_future_is_refused_by_name_and_the_drive_goes_on(lead):
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    pose(bus, x + 5.0, bus.now_ns + lead)
    told = next(item for item in node.inputs if item.topic == "pose")
    assert f"found {lead / SECOND:.3f} s" in told.last_refusal
    drive(bus, node, 10, x=x)
    assert node.loop.follower.mode.is_driving
    assert node.loop.follower.watch.pose.x < x + 2.0


def seconds_to_zero(bus, seconds=3.0):
    begun, last = bus.now_ns, 0.0
    for item in bus.advance(begun + round(seconds * SECOND)):
        if item.topic == "/cmd_vel" and item.message.twist.linear.x != 0.0:
            last = (item.stamp_ns - begun) / SECOND
    return last + 0.025  # the command after it


@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    stamps=st.lists(
        st.tuples(
            st.sampled_from(["pose", "status", "LOST"]),
            st.one_of(st.integers(-(2**31) * SECOND, 2**31 * SECOND), st.integers(-SECOND, SECOND)),
            st.integers(0, SECOND // 20),
        ),
        max_size=12,
    )
)
def test_no_stamp_however_wrong_delays_a_stop(stamps):
    """Messages with any stamps, in any order, then silence: zero command no later than without them, but for a tick."""
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    for kind, offset, pause in stamps:
        stamp = min(max(bus.now_ns + offset, 0), 2**31 * SECOND - 1)
        list(bus.advance(bus.now_ns + pause))
        if kind == "pose":
            pose(bus, x, stamp)
        else:
            status(bus, "TRACKING" if kind == "status" else kind, stamp)
        list(bus.settle())
    assert seconds_to_zero(bus) <= 0.8
    assert node.loop.follower.mode.state == "STOPPED"


@given(lead=st.integers(-5 * SECOND, 5 * SECOND))
@settings(deadline=None, max_examples=12, derandomize=True)
def test_a_camera_clock_that_is_wrong_stops_as_fast_as_silence(lead):
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    begun, last = bus.now_ns, 0.0
    for _ in range(30):
        for item in bus.advance(bus.now_ns + SECOND // 10):
            if item.topic == "/cmd_vel" and item.message.twist.linear.x != 0.0:
                last = (item.stamp_ns - begun) / SECOND
        pose(bus, x, bus.now_ns + lead)
        list(bus.settle())
    assert last <= 0.8 or -0.4 <= lead / SECOND <= 0.1  # as old as a pose may be, or as far ahead


def test_bad_news_counts_whatever_its_stamp():
    for stamp in (0, 1, 10**18):
        bus, node = follower_bus()
        drive(bus, node, 30)
        status(bus, "LOST", stamp)
        assert seconds_to_zero(bus) <= 0.4
        assert node.loop.follower.mode.verdict.reason == "NOT_LOCALISED"


def test_predictions_that_no_image_confirms_carry_the_vehicle_for_a_while_only():
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    begun, states = bus.now_ns, []
    for k in range(1, 10):
        list(bus.advance(begun + k * SECOND // 10))
        pose(bus, x + 0.1 * k, bus.now_ns)
        status(bus, "DEGRADED", bus.now_ns, "LOW_OVERLAP", age=0.1 * k)
        list(bus.settle())
        states.append(node.loop.follower.mode.state)
    assert set(states[:3]) <= {"DRIVING", "SLOW"}
    assert states[-1] == "STOPPED"
    assert "no image confirms the pose" in str(node.loop.follower.mode.verdict)


def test_two_publishers_of_the_pose_are_named_and_stop():
    bus, node = follower_bus()
    drive(bus, node, 30)
    node.shell.publishers_of = lambda topic: ["/a", "/b"]
    assert seconds_to_zero(bus) <= 0.6
    assert str(node.loop.follower.mode.verdict).startswith("POSE_SOURCE: pose is published by /a, /b: ")
    assert not node.shell.call("start").success
