"""Roll and pitch of the vehicle: by an IMU, or as the parameters say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Imu

from sphere_nav.geometry import so3
from sphere_nav.ros import qos
from sphere_nav.ros.conversions.particles import imu_attitude
from sphere_nav.ros.endpoints import Endpoints


class Attitude:
    """`tilt` (3, 3) turns axes of the base into level ones; yaw is not in it."""

    def __init__(self, endpoints: Endpoints, roll_deg: float, pitch_deg: float) -> None:
        roll, pitch = np.radians([roll_deg, pitch_deg])
        self.tilt: NDArray[np.float64] = so3.exp([0.0, pitch, 0.0]) @ so3.exp([roll, 0.0, 0.0])
        endpoints.add_subscription("imu", Imu, self._on_imu, qos.SENSOR, is_required=False)

    def _on_imu(self, message: Imu) -> None:
        attitude = so3.from_quaternion(imu_attitude(message))
        yaw = float(np.arctan2(attitude[1, 0], attitude[0, 0]))
        self.tilt = so3.exp([0.0, 0.0, -yaw]) @ attitude
