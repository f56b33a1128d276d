"""What is put together before an image is compared."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import Imu
from tf2_msgs.msg import TFMessage

from localization.status import FINE, Reason
from mcl_depth.node import MclDepthNode
from node_kit import conversions
from node_kit.replay import OfflineBus
from sphere_geometry import SE3, Spherical, so3

SECOND = 10**9
MOUNT = SE3.from_parts(so3.exp([0.0, 0.0, 0.3]), np.array([0.5, 0.0, 1.4]))


class Intaking:
    """The node's intake on a bus; images are noted, not compared."""

    def __init__(self, **values):
        self.bus = OfflineBus()
        self.intake = self.bus.add(MclDepthNode, values).intake
        self.delivered = []
        self.intake._deliver = lambda message, fault: self.delivered.append((conversions.stamp_ns(message), fault))

    def image(self, second):
        pixels = np.zeros((8, 16), np.uint8)
        self.bus.deliver("/image_raw", conversions.array_to_image(pixels, second * SECOND, "eye", "mono8"))

    def calibrate(self):
        self.bus.deliver("/sphere_info", conversions.camera_to_sphere_info(Spherical(16, 8), "eye"))

    def mount(self):
        transform = conversions.se3_to_transform(MOUNT, SECOND, "base_link", "eye")
        self.bus.deliver("/tf_static", TFMessage(transforms=[transform]))


def test_images_wait_for_calibration_and_transform_and_come_in_order():
    world = Intaking()
    world.image(1)
    world.calibrate()
    world.image(2)
    assert world.delivered == []
    world.mount()
    world.image(3)
    assert world.delivered == [(second * SECOND, FINE) for second in (1, 2, 3)]
    np.testing.assert_allclose(world.intake.T_base_level.matrix, SE3.from_parts(np.eye(3), MOUNT.translation).matrix)
    np.testing.assert_allclose(world.intake.rotation(), MOUNT.rotation, atol=1e-12)


def test_too_long_without_a_transform_is_said():
    world = Intaking(max_waiting=1)
    world.calibrate()
    world.image(1)
    world.image(2)
    assert [(stamp, fault.reason) for stamp, fault in world.delivered] == [(SECOND, Reason.TF_STALE)]


def test_an_imu_gives_roll_and_pitch_but_not_yaw():
    world = Intaking()
    level = so3.exp([0.0, 0.1, 0.0]) @ so3.exp([-0.05, 0.0, 0.0])
    attitude = SE3.from_parts(so3.exp([0.0, 0.0, 2.0]) @ level, np.zeros(3))
    message = Imu()
    q = message.orientation
    q.x, q.y, q.z, q.w = (float(value) for value in attitude.quaternion)
    world.bus.deliver("/imu", message)
    np.testing.assert_allclose(world.intake.tilt, level, atol=1e-9)


def test_odometry_is_that_of_the_camera_and_stale_after_a_while():
    world = Intaking(odometry_max_age=0.2)
    world.calibrate()
    world.mount()
    world.image(1)
    T_odom_base = SE3.from_planar(2.0, 3.0, np.pi / 2)
    message = conversions.se3_to_odometry(T_odom_base, 1e-4 * np.eye(6), SECOND, ("odom", "base_link"))
    world.bus.deliver("/odom", message)
    np.testing.assert_allclose(world.intake.T_odom_level(SECOND).translation, [2.0, 3.5, 1.4], atol=1e-9)
    assert world.intake.T_odom_level(5 * SECOND) is None
    assert world.intake.odom_frame == "odom"
