"""Roll and pitch by parameters or an IMU, never its yaw."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import Imu

from mcl_depth.ros.node import Attitude
from sphere_nav.geometry import SE3, so3
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.node import ManagedNode

LEVEL = so3.exp([0.0, 0.1, 0.0]) @ so3.exp([-0.05, 0.0, 0.0])


def test_the_parameters_hold_until_an_imu_gives_roll_and_pitch_but_not_yaw():
    bus = OfflineBus()
    attitude = Attitude(bus.add(ManagedNode).endpoints, np.degrees(-0.05), np.degrees(0.1))
    np.testing.assert_allclose(attitude.tilt, LEVEL, atol=1e-12)
    message, other = Imu(), so3.exp([0.0, -0.2, 0.0])
    q = message.orientation
    turned = SE3.from_parts(so3.exp([0.0, 0.0, 2.0]) @ other, np.zeros(3))
    q.x, q.y, q.z, q.w = (float(value) for value in turned.quaternion)
    bus.deliver("/imu", message)
    np.testing.assert_allclose(attitude.tilt, other, atol=1e-9)
