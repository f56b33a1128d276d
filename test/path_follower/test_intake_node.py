"""What the follower is driven by: poses, or directions whose frame and source are checked."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_nav_msgs.msg import FollowerStatus

from node_kit.conversions import header, se3_to_pose_stamped, se3_to_pose_with_covariance
from node_kit.replay import OfflineBus
from path_follower.intake_node import Intake
from path_follower.node import PathFollowerNode
from sphere_geometry import SE3

SECOND = 10**9


@pytest.fixture
def bus():
    bus = OfflineBus()
    bus.add(PathFollowerNode, {"source": "homing", "enable_stamped_cmd_vel": True})
    return bus


def direction(bus, angle, stamp, frame="base_link"):
    bus.deliver("/homing/direction", se3_to_pose_stamped(SE3.from_planar(0.0, 0.0, angle), stamp, frame))
    return list(bus.settle())


def source(bus, state, stamp, **values):
    bus.deliver("/homing/status", FollowerStatus(header=header(stamp, "map"), state=state, **values))
    return list(bus.settle())


def test_every_direction_is_answered_by_a_command_with_its_stamp(bus):
    node = bus.nodes[0]
    assert isinstance(node.intake, Intake)
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
    assert bus.nodes[0].follower.direction is None


def test_numbers_that_are_none_are_refused(bus):
    source(bus, "DRIVING", SECOND, progress=float("nan"))
    told = next(item for item in bus.nodes[0].inputs if item.topic == "homing/status")
    assert "expected finite lengths" in told.last_refusal


def test_poses_are_not_listened_to_while_homing(bus):
    bus.deliver("/pose", se3_to_pose_with_covariance(SE3.identity(), np.eye(6), SECOND, "map"))
    assert list(bus.settle()) == []
