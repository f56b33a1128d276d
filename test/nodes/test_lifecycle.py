"""Many lifecycles of every node over real DDS: no handle is left behind, and the node works after each."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from geometry_msgs.msg import Twist
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from sphere_nav_msgs.msg import AugmentedSphere, KeySphereGraph, LocalizationStatus
from std_msgs.msg import String, UInt64

from command_guard.node import CommandGuard
from cycab_sim.node import CycabSim
from dense_localizer.node import DenseLocalizerNode
from mcl_depth.node import MclDepthNode
from node_kit import qos
from node_kit.bag_player_node import BagPlayer
from node_kit.bag_reader import BagReader
from node_kit.bag_recorder_node import BagRecorder
from node_kit.bag_writer import BagWriter
from node_kit.conversions import array_to_image, camera_to_info, ns_to_time, stamp_ns
from node_kit.live import LiveShell
from path_follower.node import PathFollowerNode
from sphere_geometry import Pinhole
from sphere_geometry.rig_file import write_rig
from sphere_mapping.node import SphereMapper
from sphere_mapping.stitcher_node import SphereStitcher
from worlds.recordings import sphere
from worlds.rig import seen, vertical_rig

CYCLES, SETTLED = 100, 10  # what libraries allocate once is there after a few
CAMERA = Pinhole(16, 12, 10.0, 10.0, 7.5, 5.5)
RIG = vertical_rig()
IMAGES = {part.name: seen(part) for part in RIG.cameras}
PIXELS = np.random.default_rng(0).integers(20, 230, (12, 16)).astype(np.uint8)


@pytest.fixture
def executor():
    rclpy.init()
    executor = SingleThreadedExecutor()
    yield executor
    executor.shutdown()
    rclpy.shutdown()


class Peer:
    """A camera that shows images until one is answered."""

    def __init__(self, executor):
        self.node, self._executor, self.answered = Node("peer"), executor, set()
        executor.add_node(self.node)
        self.images = self.node.create_publisher(Image, "image_raw", qos.STATE)
        self.infos = self.node.create_publisher(CameraInfo, "camera_info", qos.LATCHED)
        self.node.create_subscription(
            LocalizationStatus, "status", lambda m: self.answered.add((m.state, stamp_ns(m))), qos.STATE
        )
        self.infos.publish(camera_to_info(CAMERA, 1, "base_link"))

    def show(self):
        """Show images for at most 20 s; return the state that the first answer tells."""
        self.answered.clear()
        end = time.monotonic() + 20.0
        while not self.answered and time.monotonic() < end:
            self.infos.publish(camera_to_info(CAMERA, 1, "base_link"))
            self.images.publish(array_to_image(PIXELS, time.time_ns(), "base_link", "mono8"))
            self._executor.spin_once(timeout_sec=0.05)
        return {state for state, _ in self.answered}


def num_entities(shell):
    return sum(len(list(items)) for items in (shell.subscriptions, shell.publishers, shell.services, shell.timers))


def run_cycles(executor, shell, works, num_cycles, every):
    """Live through whole lifecycles; in every so many, and in the last, the node must work. Nothing may be left."""
    executor.add_node(shell)
    handles, entities = [], []
    for cycle in range(num_cycles):
        steps = [shell.trigger_configure(), shell.trigger_activate()]
        if cycle % every == 0 or cycle == num_cycles - 1:
            assert works()
        steps += [shell.trigger_deactivate(), shell.trigger_cleanup()]
        assert set(steps) == {TransitionCallbackReturn.SUCCESS}
        executor.spin_once(timeout_sec=0.0)
        handles.append(len(os.listdir("/proc/self/fd")))
        entities.append(num_entities(shell))
    assert len(set(entities)) == 1
    settled = min(SETTLED, num_cycles // 2)
    assert max(handles[settled:]) <= handles[settled] + 1  # one: a discovery of that moment
    shell.destroy_node()


@pytest.mark.parametrize("node_class", [DenseLocalizerNode, MclDepthNode], ids=lambda item: item.NAME)
def test_a_hundred_lifecycles_leave_nothing_behind(executor, node_class):
    shell, peer = LiveShell(node_class), Peer(executor)
    run_cycles(executor, shell, lambda: peer.show() == {"NO_MAP"}, CYCLES, SETTLED)
    peer.node.destroy_node()


# --- the other nodes
def folder_of_bag(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for number in range(50):
            bag.write("text", String(data=str(number)), number * 10_000_000)
    return str(tmp_path / "bag")


def rig_file(tmp_path):
    write_rig(tmp_path / "rig.yaml", RIG)
    return str(tmp_path / "rig.yaml")


class Case(NamedTuple):
    """A node, its parameters, what to send it, and the topic that shows that it works; world-building takes long."""

    node_class: Any
    values: Callable[[Path], dict[str, Any]]
    topic: str
    kind: Any
    profile: Any = qos.STATE
    sends: Callable[[], dict[str, Any]] = dict
    cycles: int = CYCLES  # fewer where maps of pixels or a world are made each time


def pictures():
    stamp = time.time_ns()
    return {
        f"cameras/{name}/image_raw": array_to_image(image, stamp, name, "mono8" if image.ndim == 2 else "rgb8")
        for name, image in IMAGES.items()
    }


CASES = [
    Case(PathFollowerNode, lambda path: {}, "path_follower/heartbeat", UInt64, qos.COMMAND),
    Case(CommandGuard, lambda path: {}, "cmd_vel", Twist, qos.COMMAND),
    Case(BagPlayer, lambda path: {"bag": folder_of_bag(path), "loop": True}, "text", String),
    Case(SphereMapper, lambda path: {}, "graph", KeySphereGraph, qos.LATCHED, lambda: {"sphere": a_sphere()}),
    Case(SphereStitcher, lambda path: {"rig": rig_file(path), "stitch.width": 128}, "sphere", AugmentedSphere,
         qos.LARGE, pictures, 10),
    Case(CycabSim, lambda path: {"world": "corridor", "camera.is_on": False}, "/clock", Clock, qos.STATE, dict, 4),
]  # fmt: skip


def a_sphere():
    ((_, message),) = sphere(0)
    message.header.stamp = ns_to_time(time.time_ns())
    return message


class Remote:
    """Sends what a node takes, hears what it gives."""

    def __init__(self, executor, case):
        self.node, self.executor, self.case, self.num_heard = Node("remote"), executor, case, 0
        executor.add_node(self.node)
        self.node.create_subscription(case.kind, case.topic, self.hear, case.profile)
        self.publishers = {}

    def hear(self, message):
        self.num_heard += 1

    def is_answered(self):
        """Whether the node gives anything within 20 s."""
        self.num_heard, end = 0, time.monotonic() + 20.0
        while not self.num_heard and time.monotonic() < end:
            for topic, message in self.case.sends().items():
                if topic not in self.publishers:
                    self.publishers[topic] = self.node.create_publisher(type(message), topic, qos.LARGE)
                self.publishers[topic].publish(message)
            for _ in range(10):
                self.executor.spin_once(timeout_sec=0.02)
        return self.num_heard > 0


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.node_class.NAME)
def test_many_lifecycles_leave_nothing_behind(executor, tmp_path, case):
    overrides = [Parameter(name, value=value) for name, value in case.values(tmp_path).items()]
    shell, remote = LiveShell(case.node_class, parameter_overrides=overrides), Remote(executor, case)
    run_cycles(executor, shell, remote.is_answered, case.cycles, case.cycles // 2)
    remote.node.destroy_node()


def test_a_recorder_makes_a_bag_in_each_lifecycle(executor, tmp_path):
    shell, peer = LiveShell(BagRecorder, parameter_overrides=[Parameter("topics", value="text")]), Node("peer")
    publisher = peer.create_publisher(String, "text", qos.LATCHED)
    publisher.publish(String(data="hello"))
    executor.add_node(shell)
    executor.add_node(peer)
    for cycle in range(10):
        assert shell.set_parameters([Parameter("output", value=str(tmp_path / str(cycle)))])[0].successful
        shell.trigger_configure()
        shell.trigger_activate()
        end = time.monotonic() + 20.0
        while not shell.node.bag.num_messages and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        shell.trigger_deactivate()
        shell.trigger_cleanup()
        with BagReader(tmp_path / str(cycle)) as bag:
            assert bag.topics["/text"].count == 1
    shell.destroy_node()
    peer.destroy_node()


# --- an outside manager
EVERY = [DenseLocalizerNode, MclDepthNode, *(case.node_class for case in CASES), BagRecorder]


@pytest.mark.parametrize("node_class", EVERY, ids=lambda item: item.NAME)
def test_an_outside_manager_may_take_its_time(executor, tmp_path, node_class):
    """configure, a while, activate by the services of a lifecycle manager; latched messages of the while are kept."""
    values = {"output": str(tmp_path / "out"), "topics": "text"} if node_class is BagRecorder else {}
    values |= next((case.values(tmp_path) for case in CASES if case.node_class is node_class), {})
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    shell, manager = LiveShell(node_class, parameter_overrides=overrides), Node("manager")
    executor.add_node(shell)
    executor.add_node(manager)
    client = manager.create_client(ChangeState, f"{node_class.NAME}/change_state")

    def until(is_done):
        end = time.monotonic() + 20.0
        while not is_done() and time.monotonic() < end:
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
