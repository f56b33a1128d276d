"""sphere_nav_msgs/ParticleCloud against planar poses, and a cloud's call."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sphere_nav_msgs.msg import Particle, ParticleCloud

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions.poses import point_to_array, se3_to_pose
from sphere_nav.ros.conversions.stamps import header


def particles_to_message(
    poses: NDArray[np.float64], weights: NDArray[np.float64], stamp: int, frame_id: str
) -> ParticleCloud:
    """Return the cloud of poses (N, 3) x, y, yaw with weights (N,)."""
    particles = [
        Particle(pose=se3_to_pose(SE3.from_planar(float(x), float(y), float(yaw))), weight=float(weight))
        for (x, y, yaw), weight in zip(poses, weights, strict=True)
    ]
    return ParticleCloud(header=header(stamp, frame_id), particles=particles)


def imu_attitude(message: Any) -> NDArray[np.float64]:
    """Return the quaternion (4,) x, y, z, w of an Imu; ValueError where it has none."""
    q = message.orientation
    xyzw = np.array([*point_to_array(q), q.w])
    if message.orientation_covariance[0] == -1.0 or not abs(np.linalg.norm(xyzw) - 1.0) < 0.01:
        raise ValueError(f"imu.orientation: expected a unit quaternion, found {xyzw.tolist()}")
    return xyzw
