"""A hundred lifecycles of each localiser over real DDS: no handle is left behind, and the node works after each."""

import os
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from sphere_nav_msgs.msg import LocalizationStatus

from dense_localizer.node import DenseLocalizerNode
from mcl_depth.node import MclDepthNode
from node_kit import qos
from node_kit.conversions import array_to_image, camera_to_info, stamp_ns
from node_kit.live import LiveShell
from sphere_geometry import Pinhole

CYCLES, SETTLED = 100, 10  # what libraries allocate once is there after a few
CAMERA = Pinhole(16, 12, 10.0, 10.0, 7.5, 5.5)
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


@pytest.mark.parametrize("node_class", [DenseLocalizerNode, MclDepthNode], ids=lambda item: item.NAME)
def test_a_hundred_lifecycles_leave_nothing_behind(executor, node_class):
    shell, peer = LiveShell(node_class), Peer(executor)
    executor.add_node(shell)
    handles, entities = [], []
    for cycle in range(CYCLES):
        steps = [shell.trigger_configure(), shell.trigger_activate()]
        if cycle % SETTLED == 0 or cycle == CYCLES - 1:
            assert peer.show() == {"NO_MAP"}
        steps += [shell.trigger_deactivate(), shell.trigger_cleanup()]
        assert set(steps) == {TransitionCallbackReturn.SUCCESS}
        executor.spin_once(timeout_sec=0.0)
        handles.append(len(os.listdir("/proc/self/fd")))
        entities.append(num_entities(shell))
    assert len(set(entities)) == 1
    assert max(handles[SETTLED:]) <= handles[SETTLED] + 1  # one: a discovery of that moment
    shell.destroy_node()
    peer.node.destroy_node()
