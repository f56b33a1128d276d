"""What an image needs before it can be compared: calibration, the camera's place on the base, odometry, attitude."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image, Imu
from sphere_nav_msgs.msg import SphereInfo

from localization.status import FINE, Finding, Reason
from mcl_depth.params import MclDepthParams
from node_kit import conversions, qos
from node_kit.conversions.particles import imu_attitude
from node_kit.node import ManagedNode
from node_kit.tf import TransformListener
from sphere_geometry import SE3, Camera, so3
from sphere_geometry.odometry import OdometryBuffer

DEEP = qos.QoSProfile(depth=1000, reliability=qos.RELIABLE, durability=qos.VOLATILE)


class Intake:
    """Listens; hands each image on with what is still missing after a long wait (FINE: nothing)."""

    def __init__(self, node: ManagedNode, params: MclDepthParams, deliver: Callable[[Image, Finding], None]) -> None:
        self._params, self._deliver, self._tf = params, deliver, TransformListener(node)
        self.odometry, self.odom_frame = OdometryBuffer(0.2), ""
        self.camera: Camera | None = None
        self.T_base_camera: SE3 | None = None
        self._fault = Finding(Reason.BAD_INFO, detail="no camera_info or sphere_info yet")
        roll, pitch = np.radians([params.roll_deg, params.pitch_deg])
        self.tilt = so3.exp([0.0, pitch, 0.0]) @ so3.exp([roll, 0.0, 0.0])  # (3, 3), from the base to level axes
        self._waiting: deque[Image] = deque()
        profile = DEEP if params.every_image else qos.SENSOR
        node.add_subscription("camera_info", CameraInfo, self._on_camera_info, profile, is_required=False)
        node.add_subscription("sphere_info", SphereInfo, self._on_sphere_info, profile, is_required=False)
        node.add_subscription("image_raw", Image, self._on_image, profile)
        node.add_subscription("odom", Odometry, self._on_odometry, qos.SENSOR, is_required=False)
        node.add_subscription("imu", Imu, self._on_imu, qos.SENSOR, is_required=False)

    @property
    def T_base_level(self) -> SE3:
        """The camera's centre with the axes of the base."""
        assert self.T_base_camera is not None
        return SE3.from_parts(np.eye(3), self.T_base_camera.translation)

    def rotation(self) -> np.ndarray:
        """Return (3, 3) from camera to level axes."""
        assert self.T_base_camera is not None
        rotation: np.ndarray = self.tilt @ self.T_base_camera.rotation
        return rotation

    def T_odom_level(self, stamp_ns: int) -> SE3 | None:
        """Return odometry of the level camera at a stamp."""
        T_odom_base = self.odometry.at(stamp_ns)
        return T_odom_base @ self.T_base_level if T_odom_base is not None else None

    def _on_camera_info(self, message: CameraInfo) -> None:
        try:
            self.camera = conversions.camera_from_info(message)
        except ValueError as error:
            self.camera, self._fault = None, Finding(Reason.BAD_INFO, detail=str(error))
            raise

    def _on_sphere_info(self, message: SphereInfo) -> None:
        self.camera = conversions.sphere_info_to_camera(message)

    def _on_odometry(self, message: Odometry) -> None:
        T_odom_base, twist = conversions.odometry_to_se3(message)
        self.odometry.add(conversions.stamp_ns(message), T_odom_base, twist)
        self.odom_frame = message.header.frame_id

    def _on_imu(self, message: Imu) -> None:
        attitude = so3.from_quaternion(imu_attitude(message))
        yaw = float(np.arctan2(attitude[1, 0], attitude[0, 0]))
        self.tilt = so3.exp([0.0, 0.0, -yaw]) @ attitude

    def _on_image(self, message: Image) -> None:
        self._waiting.append(message)
        while self._waiting:
            fault = self._what_is_missing(self._waiting[0])
            if fault is not FINE and len(self._waiting) <= self._params.max_waiting:
                return
            self._deliver(self._waiting.popleft(), fault)

    def _what_is_missing(self, message: Image) -> Finding:
        if self.camera is None:
            return self._fault
        base, frame = self._params.base_frame, self._params.camera_frame or message.header.frame_id
        if self.T_base_camera is None:
            try:
                self.T_base_camera = self._tf.lookup(base, frame) if base and frame != base else SE3.identity()
            except ValueError as error:
                return Finding(Reason.TF_STALE, detail=str(error))
        return FINE
