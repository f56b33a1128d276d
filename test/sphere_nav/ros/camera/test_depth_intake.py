"""Depth beside images: each goes on once, in order, with the depth of its instant or without."""

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.localization.params import NodeParams
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.intake import Cameras
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.ros.node import ManagedNode

SLACK_S = 0.01  # written out: imported, a change would go unseen

SECOND = 10**9
CAMERA, DEPTH_CAMERA = Pinhole(16, 8, 10.0, 10.0, 7.5, 3.5), Pinhole(12, 6, 9.0, 8.0, 5.5, 2.5)
T_IMAGE_DEPTH = SE3.exp([0.05, 0.0, 0.01, 0.0, 0.02, 0.0])


class Gate:
    def __init__(self):
        self.bus, self.pictures, params = OfflineBus(), [], NodeParams(mounting="0,0,1,0,0,0")
        self.node = self.bus.add(ManagedNode)
        self.intake = Cameras(self.node.endpoints, params, self.pictures.append, pytest.fail, has_depth=True)
        self.send("camera_info", camera_to_info(CAMERA, 1, "optical"))

    def send(self, topic, message):
        self.bus.deliver(f"/{topic}", message)

    def image(self, second):
        pixels = np.full((8, 16), second, np.uint8)
        self.send("image_raw", array_to_image(pixels, round(second * SECOND), "optical", "mono8"))

    def depth(self, second, meters=2.0, shape=(8, 16), frame="optical"):
        pixels = np.full(shape, meters, np.float32)
        self.send("depth/image_raw", array_to_image(pixels, round(second * SECOND), frame, "32FC1"))

    def seen(self):
        return [(p.stamp_ns // SECOND, p.depth and float(p.depth.depth_m[0, 0])) for p in self.pictures]

    def refusal(self):
        return next(item for item in self.node.inputs if item.topic == "depth/image_raw").last_refusal


@pytest.mark.parametrize("order", [("image", "depth"), ("depth", "image")])
def test_an_image_goes_on_with_the_depth_of_its_instant(order):
    gate = Gate()
    for second in (1, 2):
        for kind in order:
            gate.depth(second + 0.4 * SLACK_S, 2.0 + second) if kind == "depth" else gate.image(second)
    assert gate.seen() == [(1, 3.0), (2, 4.0)]
    assert gate.pictures[0].depth.camera == CAMERA
    np.testing.assert_array_equal(gate.pictures[0].depth.T_image_depth.matrix, np.eye(4))


def test_depth_a_hundredth_of_a_second_and_a_half_later_is_of_no_image():
    gate = Gate()
    for second in (1, 2):
        gate.image(second)
        gate.depth(second + 1.5 * SLACK_S * (second == 1), 2.0 + second)
    assert gate.seen() == [(1, None), (2, 4.0)]


def test_an_image_without_depth_waits_for_the_next_one_and_after_some_for_none():
    gate = Gate()
    gate.image(1)
    assert gate.seen() == []
    gate.depth(1.5)  # of no image
    for second in (2, 3, 4):
        gate.image(second)
    assert gate.seen()[:2] == [(1, None), (2, None)]
    for second in (5, 6):
        gate.image(second)
    assert gate.seen()[-1] == (6, None)  # no depth for long: it is not waited for
    gate.depth(7, 5.0)
    gate.image(7)
    assert gate.seen()[-1] == (7, 5.0)


def test_depth_of_a_camera_beside_is_placed_by_tf():
    gate = Gate()
    gate.send("depth/camera_info", camera_to_info(DEPTH_CAMERA, 1, "depth_optical"))
    gate.image(1)
    gate.depth(1, shape=(6, 12), frame="depth_optical")
    assert gate.seen() == [(1, None)]  # nobody says where it is: the image does not suffer from that
    assert "depth_optical" in gate.refusal()
    gate.send("tf_static", TFMessage(transforms=[se3_to_transform(T_IMAGE_DEPTH, SECOND, "optical", "depth_optical")]))
    gate.image(2)
    gate.depth(2, shape=(6, 12), frame="depth_optical")
    found = gate.pictures[-1].depth
    assert found.camera == DEPTH_CAMERA
    np.testing.assert_allclose(found.T_image_depth.matrix, T_IMAGE_DEPTH.matrix, atol=1e-12)


def test_depth_that_cannot_be_read_costs_no_image():
    gate = Gate()
    gate.image(1)
    gate.depth(1, shape=(6, 12))
    assert gate.seen() == [(1, None)]
    assert "expected 16 x 8" in gate.refusal()


def test_after_a_jump_of_the_clock_nothing_old_is_joined():
    gate = Gate()
    gate.image(5)
    gate.intake.clear()
    gate.depth(5)
    gate.image(6)
    gate.depth(6, 3.0)
    assert gate.seen() == [(6, 3.0)]
