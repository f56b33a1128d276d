"""Many lifecycles of every node over real DDS: no handle is left behind, and the node works after each."""

import os
import time
from typing import Any

import pytest

pytest.importorskip("rclpy")

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from sphere_nav.ros import qos
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorder_node import BagRecorder
from sphere_nav.ros.live import LiveShell
from worlds.node_cases import CASES
from worlds.patience import Patience

SETTLED = 10  # what libraries allocate once is there after as many
CYCLES = 3 * SETTLED  # what is left behind each time is 19 after as many
PATIENCE = 20.0  # s for an answer; discovery takes a fraction of one, on a busy machine several


class Bench:
    """A node beside one that sends what it takes and hears what it gives."""

    def __init__(self, executor: Any, case: Any, folder) -> None:
        self.executor, self.case, self.folder, self.num_heard = executor, case, folder, 0
        self.shell = LiveShell(case.node_class, parameter_overrides=self._values())
        self.peer = Node("peer")
        for node in (self.shell, self.peer):
            executor.add_node(node)
        if case.topic:
            self.peer.create_subscription(case.kind, case.topic, self.hear, case.profile)
        self.publishers: dict[str, Any] = {}

    def _values(self) -> list[Parameter]:
        return [Parameter(name, value=value) for name, value in self.case.values(self.folder).items()]

    def renew(self) -> None:
        """Set the parameters of the next lifecycle."""
        if not all(result.successful for result in self.shell.set_parameters(self._values())):
            raise ValueError("parameters: refused while the node is unconfigured")

    def hear(self, message: Any) -> None:
        """Count what the node gives."""
        self.num_heard += 1

    def works(self) -> bool:
        """Whether the node gives anything in time."""
        self.num_heard, end = 0, time.monotonic() + PATIENCE
        while not self.num_heard and time.monotonic() < end:
            for topic, message in self.case.sends().items():
                if topic not in self.publishers:
                    self.publishers[topic] = self.peer.create_publisher(type(message), topic, qos.LARGE)
                self.publishers[topic].publish(message)
            for _ in range(5):
                self.executor.spin_once(timeout_sec=0.01)
            if not self.case.topic:
                recorder: Any = self.shell.node
                self.num_heard = recorder.bag.num_messages
        return self.num_heard > 0

    def close(self) -> None:
        """Give both nodes back."""
        self.shell.destroy_node()
        self.peer.destroy_node()


def live(bench, num_cycles, every):
    """Live through whole lifecycles; return how many steps failed, and the entities and open files left at the end.

    In every so many lifecycles, and in the last, the node must work.
    """
    num_failed, entities, handles = 0, [], []
    shell = bench.shell
    for cycle in range(num_cycles):
        bench.renew()
        steps = [shell.trigger_configure(), shell.trigger_activate()]
        if cycle % every == 0 or cycle == num_cycles - 1:
            num_failed += not bench.works()
        steps += [shell.trigger_deactivate(), shell.trigger_cleanup()]
        num_failed += sum(step != TransitionCallbackReturn.SUCCESS for step in steps)
        bench.executor.spin_once(timeout_sec=0.0)
        handles.append(len(os.listdir("/proc/self/fd")))
        kinds = (shell.subscriptions, shell.publishers, shell.services, shell.timers)
        entities.append(sum(len(list(items)) for items in kinds))
    return num_failed, max(entities) - entities[0], max(handles[SETTLED:]) - handles[SETTLED]


@pytest.fixture
def executor():
    rclpy.init()
    executor = SingleThreadedExecutor()
    yield executor
    executor.shutdown()
    rclpy.shutdown()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.node_class.NAME)
def test_many_lifecycles_leave_nothing_behind(executor, tmp_path, case):
    bench = Bench(executor, case, tmp_path)
    num_failed, left_entities, left_handles = live(bench, CYCLES, every=SETTLED)
    assert (num_failed, left_entities) == (0, 0)
    assert left_handles <= 1  # one: a discovery of that moment
    bench.close()
    if case.node_class is BagRecorder:
        for cycle in range(0, CYCLES, SETTLED):
            with BagReader(tmp_path / str(cycle)) as bag:
                assert bag.topics["/text"].count > 0


# --- an outside manager
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.node_class.NAME)
def test_an_outside_manager_may_take_its_time(executor, tmp_path, case):
    """configure, a while, activate by the services of a lifecycle manager; latched messages of the while are kept."""
    overrides = [Parameter(name, value=value) for name, value in case.values(tmp_path).items()]
    shell, manager = LiveShell(case.node_class, parameter_overrides=overrides), Node("manager")
    executor.add_node(shell)
    executor.add_node(manager)
    client = manager.create_client(ChangeState, f"{case.node_class.NAME}/change_state")

    def until(is_done):
        patience = Patience(20.0)
        while not is_done() and patience.is_left():
            executor.spin_once(timeout_sec=0.05)
        assert is_done()

    def change(number):
        answer = client.call_async(ChangeState.Request(transition=Transition(id=number)))
        until(answer.done)
        assert answer.result().success

    until(client.service_is_ready)
    change(Transition.TRANSITION_CONFIGURE)
    latched = [item for item in shell.node.inputs if item.profile.durability == qos.TRANSIENT_LOCAL]
    for item in latched:
        publisher = manager.create_publisher(item.kind, item.handle.topic_name, qos.LATCHED)
        publisher.publish(item.kind())
    until(lambda: all(item.kept for item in latched))
    change(Transition.TRANSITION_ACTIVATE)
    until(lambda: shell.is_active and all(item.num_received for item in latched))
    change(Transition.TRANSITION_DEACTIVATE)
    change(Transition.TRANSITION_CLEANUP)
    shell.destroy_node()
    manager.destroy_node()
