"""Where the node's trajectory comes from; what cannot be read changes nothing."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from path_follower.params import FollowerParams
from path_follower.ros.node import PathFollowerNode
from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import poses_to_path

MAX_PATH_BYTES = 8_000_000

SECOND = 1_000_000_000


def taught(speed=0.0, length=10.0):
    """A straight path; stamps of a drive at `speed` m/s, or none."""
    stamps = [round(x / speed * SECOND) if speed else 0 for x in np.arange(0, length, 0.1)]
    return poses_to_path([(ns, SE3.from_planar(0.1 * i, 0, 0)) for i, ns in enumerate(stamps)], SECOND, "map")


@pytest.fixture
def node():
    return OfflineBus().add(PathFollowerNode)


def test_a_path_with_stamps_is_driven_as_it_was_taught_and_else_at_cruise_speed(node):
    node.on_path(taught(speed=0.6))
    assert node.loop.follower.path.speed.max() == pytest.approx(0.6, rel=0.02)
    node.on_path(taught(length=12.0))
    assert node.loop.follower.path.speed.max() == pytest.approx(FollowerParams().speed.cruise)


def test_orientations_that_were_never_filled_in_are_no_headings(node):
    west = poses_to_path([(0, SE3.from_planar(-0.1 * i, 0, 0)) for i in range(50)], SECOND, "map")
    node.on_path(west)
    assert [segment.direction for segment in node.loop.follower.path.segments] == [1]
    for item in west.poses:
        item.pose.orientation.z, item.pose.orientation.w = 1e-3, 1.0
    node.on_path(west)
    assert node.loop.follower.path.segments[0].direction == 1  # the same points again: nothing new
    node.points = np.empty((0, 2))
    node.on_path(west)
    assert node.loop.follower.path.segments[0].direction == -1  # told, and it fits


def test_a_path_that_comes_again_does_not_disturb_the_drive(node):
    node.on_path(taught())
    first = node.loop.follower.path
    node.on_path(taught())
    assert node.loop.follower.path is first
    node.on_path(taught(length=12.0))
    assert node.loop.follower.path.length == pytest.approx(11.9)


def test_a_message_that_would_be_read_for_minutes_is_refused_unread(node):
    with pytest.raises(ValueError, match=f"expected at most {MAX_PATH_BYTES} bytes, found 72000028"):
        node.read_path(bytes(72_000_028))
    node.read_path(serialize_message(taught(length=5.0)))
    assert node.loop.follower.path.length == pytest.approx(4.9)


def test_a_bend_that_the_car_cannot_take_is_told_and_a_straight_path_has_none(node, caplog):
    caplog.set_level("INFO")
    node.on_path(taught())
    turns = [SE3.from_planar(np.sin(a), 1.0 - np.cos(a), a) for a in np.arange(0.0, 1.5, 0.05)]
    node.on_path(poses_to_path([(0, pose) for pose in turns], SECOND, "map"))
    straight, bent = [record.getMessage() for record in caplog.records][-2:]
    assert straight.endswith("trajectory of 9.9 m")
    assert "m bends to 1.0 m radius: the car cannot turn tighter than 2.5 m" in bent
