"""Poses and covariances: round trips, the fixed axes of ROS, and no NaN in or out."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseStamped
from sensor_msgs.msg import Imu

from sphere_nav.geometry import SE3, so3
from sphere_nav.ros.conversions import (
    from_ros_covariance,
    header,
    ns_to_time,
    pose_to_se3,
    se3_to_odometry,
    se3_to_pose,
    stamp_ns,
    time_to_ns,
    to_ros_covariance,
)
from sphere_nav.ros.conversions.poses import imu_attitude

POSE = SE3.exp([1.0, -2.0, 0.5, 0.4, -0.3, 2.1])


@pytest.fixture
def covariance(rng):
    root = rng.normal(size=(6, 6))
    return (root @ root.T + np.eye(6)) * 1e-8


def test_a_covariance_is_about_the_fixed_axes(rng, covariance):
    """Sample local perturbations; ROS's numbers are position, and rotation about the axes of the frame."""
    xi = rng.multivariate_normal(np.zeros(6), covariance, 20000)
    samples = POSE @ SE3.exp(xi)
    positions = samples.translation - POSE.translation
    rotations = so3.log(samples.rotation @ POSE.rotation.T)
    sampled = np.cov(np.hstack([positions, rotations]).T)
    found = np.reshape(to_ros_covariance(covariance, POSE), (6, 6))
    scale = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    np.testing.assert_allclose(sampled / scale, found / scale, atol=0.04)  # 5 / sqrt(20000) = 5 standard errors


def test_bad_numbers_are_refused_with_their_field():
    for field in ("position", "orientation"):
        pose = Pose()
        getattr(pose, field).x = float("nan")
        with pytest.raises(ValueError, match=rf"pose\.{field}: expected"):
            pose_to_se3(pose)
    with pytest.raises(ValueError, match="covariance: expected finite numbers, none negative"):
        from_ros_covariance(-np.eye(6).ravel(), POSE)


def test_no_nan_goes_out():
    with pytest.raises(ValueError, match="pose: expected finite numbers"):
        se3_to_pose(SE3(np.full((4, 4), np.nan)))
    with pytest.raises(ValueError, match="covariance: expected finite"):
        to_ros_covariance(np.full((6, 6), np.nan), POSE)
    with pytest.raises(ValueError, match="twist: expected finite"):
        se3_to_odometry(POSE, np.eye(6), 1, ("a", "b"), [np.nan] * 6)


def test_a_time_comes_back_to_the_nanosecond_or_is_refused_where_no_message_can_hold_it():
    for ns in [0, 1, 999_999_999, 1_000_000_000, 1_778_234_353_382_747_001, (2**31) * 10**9 - 1]:
        assert time_to_ns(ns_to_time(ns)) == ns
        assert stamp_ns(PoseStamped(header=header(ns, "map"))) == ns
    for ns in [-1, 2**31 * 10**9]:
        with pytest.raises(ValueError, match="stamp: expected 0 to"):
            ns_to_time(ns)
    for time in [Time(sec=-1, nanosec=342_388_850), Time(sec=2**31 - 1, nanosec=10**9)]:
        with pytest.raises(ValueError, match="stamp: expected 0 to 2"):
            time_to_ns(time)


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
