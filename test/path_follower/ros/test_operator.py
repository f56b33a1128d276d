"""The operator's calls: each does what it says, or answers why not."""

import pytest

pytest.importorskip("rclpy")

from std_msgs.msg import Bool

from path_follower.modes import FollowerState
from path_follower.path import Pose2
from path_follower.ros.node import PathFollowerNode
from sphere_nav.ros.bags.replay import OfflineBus

SECOND = 1_000_000_000


@pytest.fixture
def node(kit):
    node = OfflineBus().add(PathFollowerNode)
    node.loop.follower.load(kit.make_path([(0, 0), (10, 0)], node.params))
    node.loop.follower.update(Pose2(0, 0, 0), None, SECOND, "TRACKING")
    return node


def test_the_calls_lead_through_the_states(node):
    states = []
    for name in ("start", "pause", "resume", "stop"):
        assert node.shell.call(name).success
        states.append(node.loop.follower.mode.state)
    assert states == [FollowerState.DRIVING, FollowerState.PAUSED, FollowerState.DRIVING, FollowerState.STOPPING]


def test_a_refusal_says_why(node):
    answer = node.shell.call("resume")
    assert (answer.success, answer.message) == (False, "nothing to resume: IDLE")


def test_the_emergency_stop_is_handed_on(node):
    emergency = next(entry for entry in node.inputs if entry.topic == "emergency_stop")
    emergency.deliver(Bool(data=True))
    assert node.shell.call("start").message.startswith("EMERGENCY_STOP")
    emergency.deliver(Bool(data=False))
    assert node.shell.call("start").success
