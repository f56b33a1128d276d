"""Many lifecycles of every node over real DDS: no handle is left behind, and the node works after each."""

import pytest

pytest.importorskip("rclpy")

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from benchmarks.lifecycle import SETTLED, live
from benchmarks.lifecycle_cases import CASES, Bench
from sphere_nav.ros import qos
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorder_node import BagRecorder
from sphere_nav.ros.live import LiveShell
from worlds.patience import Patience

CYCLES = 3 * SETTLED  # what is left behind each time is 19 after as many; `python -m benchmarks lifecycle` lives 100


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
    lives = live(bench, CYCLES, every=SETTLED)
    assert (lives.num_failed, lives.left_entities) == (0, 0)
    assert lives.left_handles <= 1  # one: a discovery of that moment
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
