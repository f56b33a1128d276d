"""geometry_msgs and nav_msgs poses against SE3.

A covariance of ours belongs to xi = (v, omega) in T @ exp(xi): axes of the moving body. ROS wants the axes of the
header's frame: x, y, z, rotation about fixed X, Y, Z. To first order delta_fixed = blkdiag(R, R) xi.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from nav_msgs.msg import Odometry, Path
from numpy.typing import ArrayLike
from sensor_msgs.msg import Imu

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import MAX_NUMBER, told_at
from sphere_nav.ros.conversions.headers import check_frames, header, stamp_ns

NORM_TOLERANCE = 0.01  # a quaternion from a message may be rounded, not arbitrary


def point_to_array(point: Point | Vector3) -> Array:
    """Return (3,) in m."""
    return np.array([point.x, point.y, point.z])


def quaternion_to_array(orientation: Quaternion, name: str) -> Array:
    """Return (4,) x, y, z, w; ValueError unless it is of unit length."""
    q = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    if not abs(np.linalg.norm(q) - 1.0) < NORM_TOLERANCE:
        raise ValueError(f"{name}.orientation: expected a unit quaternion, found {q.tolist()}")
    return q


def imu_attitude(message: Imu) -> Array:
    """Return the quaternion (4,) x, y, z, w of an Imu; ValueError where it has none."""
    if message.orientation_covariance[0] == -1.0:
        raise ValueError("imu.orientation: expected a unit quaternion, found none (covariance -1)")
    return quaternion_to_array(message.orientation, "imu")


def pose_to_se3(pose: Pose, name: str = "pose") -> SE3:
    """Return T_frame_body; ValueError if a number is not finite or the quaternion is not of unit length."""
    return _to_se3(pose.position, pose.orientation, name)


def se3_to_pose(T_frame_body: SE3) -> Pose:
    """Return a Pose; ValueError rather than a NaN."""
    position = Point(**_named("xyz", T_frame_body.translation, "pose"))
    return Pose(position=position, orientation=Quaternion(**_named("xyzw", T_frame_body.quaternion, "pose")))


def se3_to_pose_stamped(T_frame_body: SE3, stamp: int, frame_id: str) -> PoseStamped:
    """Return a PoseStamped, stamp in ns."""
    return PoseStamped(header=header(stamp, frame_id), pose=se3_to_pose(T_frame_body))


def transform_to_se3(transform: Transform, name: str = "transform") -> SE3:
    """Return T_parent_child."""
    return _to_se3(transform.translation, transform.rotation, name)


def se3_to_transform(T_parent_child: SE3, stamp: int, parent: str, child: str) -> TransformStamped:
    """Return a TransformStamped, stamp in ns."""
    message = TransformStamped(header=header(stamp, parent), child_frame_id=child)
    message.transform.translation = Vector3(**_named("xyz", T_parent_child.translation, "transform"))
    message.transform.rotation = Quaternion(**_named("xyzw", T_parent_child.quaternion, "transform"))
    return message


def to_ros_covariance(covariance: ArrayLike, T_frame_body: SE3) -> list[float]:
    """Return the 36 numbers of a message from a local covariance (6, 6) of (v, omega)."""
    axes = np.kron(np.eye(2), T_frame_body.rotation)
    fixed = axes @ np.asarray(covariance, dtype=np.float64) @ axes.T
    if fixed.shape != (6, 6) or not np.all(np.isfinite(fixed)):
        raise ValueError(f"covariance: expected finite (6, 6), found {np.asarray(covariance).tolist()}")
    return [float(value) for value in (0.5 * (fixed + fixed.T)).ravel()]


def from_ros_covariance(numbers: ArrayLike, T_frame_body: SE3) -> Array:
    """Return the local covariance (6, 6) of (v, omega) from the 36 numbers of a message."""
    axes = np.kron(np.eye(2), T_frame_body.rotation)
    fixed = np.asarray(numbers, dtype=np.float64).reshape(6, 6)
    if not np.all(np.isfinite(fixed)) or np.any(np.diagonal(fixed) < 0):
        raise ValueError(f"covariance: expected finite numbers, none negative on the diagonal, found {fixed.tolist()}")
    return axes.T @ (0.5 * (fixed + fixed.T)) @ axes


def move_covariance(covariance: ArrayLike, T_new_old: SE3) -> Array:
    """Return the local covariance of T_frame_new from that of T_frame_old, both fixed to one body."""
    adjoint = T_new_old.adjoint()
    return adjoint @ np.asarray(covariance, dtype=np.float64) @ adjoint.T


def with_covariance(T_frame_body: SE3, covariance: ArrayLike) -> PoseWithCovariance:
    """Return a PoseWithCovariance; `covariance` (6, 6) is local."""
    return PoseWithCovariance(pose=se3_to_pose(T_frame_body), covariance=to_ros_covariance(covariance, T_frame_body))


def and_covariance(message: PoseWithCovariance) -> tuple[SE3, Array]:
    """Return T_frame_body and its local covariance (6, 6)."""
    T_frame_body = pose_to_se3(message.pose)
    return T_frame_body, from_ros_covariance(message.covariance, T_frame_body)


def se3_to_pose_with_covariance(
    T_frame_body: SE3, covariance: ArrayLike, stamp: int, frame_id: str
) -> PoseWithCovarianceStamped:
    """Return a PoseWithCovarianceStamped; `covariance` (6, 6) is local."""
    return PoseWithCovarianceStamped(header=header(stamp, frame_id), pose=with_covariance(T_frame_body, covariance))


def pose_with_covariance_to_se3(message: PoseWithCovarianceStamped, frame_id: str = "") -> tuple[SE3, Array]:
    """Return T_frame_body and its local covariance (6, 6); `frame_id`: the frame that it must be given in."""
    if frame_id:
        with told_at("pose"):
            check_frames(message, frame_id)
    return and_covariance(message.pose)


def se3_to_odometry(
    T_frame_body: SE3,
    covariance: ArrayLike,
    stamp: int,
    frames: tuple[str, str],
    twist: ArrayLike = (0.0,) * 6,
    twist_covariance: ArrayLike = (0.0,) * 36,
) -> Odometry:
    """Return an Odometry; `frames` are (header, child); the twist (v, omega) is in the child's axes, as is ours."""
    told = with_covariance(T_frame_body, covariance)
    message = Odometry(header=header(stamp, frames[0]), child_frame_id=frames[1], pose=told)
    velocity = np.asarray(twist).ravel()
    message.twist.twist.linear = Vector3(**_named("xyz", velocity[:3], "twist"))
    message.twist.twist.angular = Vector3(**_named("xyz", velocity[3:], "twist"))
    message.twist.covariance = [float(value) for value in np.asarray(twist_covariance).ravel()]
    return message


def odometry_to_se3(message: Odometry) -> tuple[SE3, Array]:
    """Return T_frame_child and the twist (6,) as (v, omega) in the child's axes, m/s and rad/s."""
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    twist = np.concatenate([point_to_array(linear), point_to_array(angular)])
    if not np.all(np.isfinite(twist)):
        raise ValueError(f"odometry twist: expected finite numbers, found {twist.tolist()}")
    return pose_to_se3(message.pose.pose, "odometry pose"), twist


def poses_to_path(poses: Iterable[tuple[int, SE3]], stamp: int, frame_id: str) -> Path:
    """Return a Path of (stamp in ns, T_frame_body)."""
    return Path(header=header(stamp, frame_id), poses=[se3_to_pose_stamped(T, ns, frame_id) for ns, T in poses])


def path_to_poses(message: Path) -> list[tuple[int, SE3]]:
    """Return (stamp in ns, T_frame_body) of every pose, without turn where its orientation is all zeros.

    ValueError if one is in another frame than the path.
    """
    found = []
    for index, item in enumerate(message.poses):
        if item.header.frame_id not in ("", message.header.frame_id):
            expected, frame = message.header.frame_id, item.header.frame_id
            raise ValueError(f"path: poses[{index}].header.frame_id: expected {expected!r}, found {frame!r}")
        q = item.pose.orientation
        if not any((q.x, q.y, q.z, q.w)):  # never filled in
            q.w = 1.0
        found.append((stamp_ns(item), pose_to_se3(item.pose, f"poses[{index}]")))
    return found


def _to_se3(position: Point | Vector3, orientation: Quaternion, name: str) -> SE3:
    t = point_to_array(position)
    if not np.all(np.abs(t) <= MAX_NUMBER):
        raise ValueError(f"{name}.position: expected finite numbers, found {t.tolist()}")
    return SE3.from_quaternion(quaternion_to_array(orientation, name), t)


def _named(names: str, values: Array, what: str) -> dict[str, float]:
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{what}: expected finite numbers, found {values.tolist()}")
    return dict(zip(names, map(float, values), strict=True))
