"""Particles and attitudes in messages."""

import numpy as np
import pytest
from sensor_msgs.msg import Imu

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions import pose_to_se3, stamp_ns
from sphere_nav.ros.conversions.beliefs import imu_attitude, particles_to_message


def test_particles_keep_pose_weight_and_stamp():
    poses, weights = np.array([[1.0, -2.0, 0.5], [3.0, 4.0, -3.0]]), np.array([0.25, 0.75])
    message = particles_to_message(poses, weights, 1_500_000_000, "map")
    assert (stamp_ns(message), message.header.frame_id) == (1_500_000_000, "map")
    for particle, pose, weight in zip(message.particles, poses, weights, strict=True):
        np.testing.assert_allclose(pose_to_se3(particle.pose).matrix, SE3.from_planar(*pose).matrix, atol=1e-12)
        assert particle.weight == weight


def imu(*xyzw):
    message = Imu()
    q = message.orientation
    q.x, q.y, q.z, q.w = xyzw
    return message


def test_an_attitude_is_read_where_there_is_one():
    np.testing.assert_allclose(imu_attitude(imu(0.6, 0.0, 0.0, 0.8)), [0.6, 0.0, 0.0, 0.8])
    unknown = imu(0.0, 0.0, 0.0, 1.0)
    unknown.orientation_covariance[0] = -1.0
    for message in (unknown, imu(0.0, 0.0, 0.0, 0.0), imu(float("nan"), 0.0, 0.0, 1.0)):
        with pytest.raises(ValueError, match=r"imu\.orientation: expected a unit quaternion"):
            imu_attitude(message)
