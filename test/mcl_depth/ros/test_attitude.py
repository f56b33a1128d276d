"""Roll and pitch by parameters or an IMU, never its yaw."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import Imu

from mcl_depth.belief.estimate import Estimate
from mcl_depth.ros.node import Attitude, to_base
from sphere_nav.geometry import SE3, so3
from sphere_nav.localization.status import State, Status
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


def test_the_base_hangs_below_the_levelled_camera_and_is_unsure_as_that_is(rng):
    """By Monte Carlo: a camera ahead of the base and above it, unsure of its heading most of all."""
    T_map_level, T_base_level = SE3.from_planar(3.0, -2.0, 0.7), SE3.from_parts(np.eye(3), [2.0, 0.3, 1.5])
    status = Status(State.TRACKING)
    found = to_base(Estimate(status, T_map_level, np.eye(6)), T_base_level, LEVEL)
    T_map_eye = found.T_map_base @ T_base_level
    np.testing.assert_allclose(
        T_map_eye.matrix, SE3.from_parts(T_map_level.rotation @ LEVEL, T_map_level.translation).matrix
    )
    root = np.diag([0.02, 0.01, 0.005, 0.001, 0.002, 0.02])
    root[5, 1] = 0.01
    steep = so3.exp([0.0, 0.6, 0.0]) @ so3.exp([-0.4, 0.0, 0.0])
    found = to_base(Estimate(status, T_map_level, root @ root.T), T_base_level, steep)
    T_level_base = SE3.from_parts(steep, np.zeros(3)) @ T_base_level.inverse()
    drawn = T_map_level @ SE3.exp(rng.normal(size=(5_000, 6)) @ root.T) @ T_level_base
    expected = np.cov((found.T_map_base.inverse() @ drawn).log().T)
    sigma = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(found.covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.1)
    assert to_base(Estimate(status), T_base_level, LEVEL).T_map_base is None
