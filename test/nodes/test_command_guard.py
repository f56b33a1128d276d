"""The node command_guard on an offline bus: commands pass while they come, and while their sender beats."""

import pytest
from geometry_msgs.msg import Twist
from std_msgs.msg import UInt64

from path_follower.ros.guard_node import CommandGuard
from sphere_nav.ros.bags.replay import OfflineBus

STEP = 50_000_000


class Bench:
    def __init__(self):
        self.bus = OfflineBus()
        self.node = self.bus.add(CommandGuard)
        self.now, self.beats = 10**9, 0

    def run(self, count, speed=None):
        """Return the speeds that the base gets."""
        said = []
        for _ in range(count):
            self.now += STEP
            said += self.bus.advance(self.now)
            if speed is not None:
                twist = Twist()
                twist.linear.x = speed
                self.bus.deliver("/cmd_vel_in", twist)
            self.beats += 1
            self.bus.deliver("/path_follower/heartbeat", UInt64(data=self.beats))
        return [item.message.linear.x for item in said if item.topic == "/cmd_vel"]


@pytest.fixture
def driving():
    bench = Bench()
    bench.run(5, 0.0)
    assert bench.run(40, 1.0)[-1] == 1.0
    return bench


def test_a_silent_sender_ends_in_zero_and_the_reason_is_told(driving):
    speeds = driving.run(12)  # 0.6 s
    assert speeds[-1] == 0.0
    assert driving.node.reports["guard"][1] == "stopped: NO_COMMAND: none for more than 0.25 s"


def test_deactivation_leaves_a_zero_command(driving):
    driving.node.deactivate()
    last = [item for item in driving.bus.settle() if item.topic == "/cmd_vel"][-1]
    assert last.message.linear.x == 0.0


def test_a_guard_tells_the_follower_only_when_the_base_stands(driving):
    """Sending to a process that hangs may take seconds: not before the ramp has ended."""
    order = []
    for _ in range(12):
        driving.now += STEP
        for item in driving.bus.advance(driving.now):
            if item.topic == "/cmd_vel":
                order.append(item.message.linear.x)
            elif item.topic == "/command_guard/status":
                order.append(item.message.reason)
    first = next(k for k, said in enumerate(order) if isinstance(said, str) and said)
    assert order[first] == "NO_COMMAND"
    assert order[first - 1] == 0.0
    assert not [said for said in order[:first] if said == ""][1:]
