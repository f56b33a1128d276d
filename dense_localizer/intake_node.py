"""What an image needs before it can be localised: calibration, the place of its camera on the base, odometry."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from dense_localizer.params import DenseLocalizerParams
from localization.status import FINE, Finding, Reason
from node_kit import conversions, qos
from node_kit.node import ManagedNode
from node_kit.tf import TransformListener
from sphere_geometry import SE3, Camera
from sphere_geometry.odometry import OdometryBuffer

DEEP = qos.QoSProfile(depth=1000, reliability=qos.RELIABLE, durability=qos.VOLATILE)

Picture: TypeAlias = Any  # Image or CompressedImage, by the parameter transport


class Intake:
    """Listens; hands each image on, in order, with what is still missing after a long wait (FINE: nothing)."""

    def __init__(
        self, node: ManagedNode, params: DenseLocalizerParams, deliver: Callable[[Picture, Finding], None]
    ) -> None:
        self._params, self._deliver = params, deliver
        self.odometry = OdometryBuffer(0.2)
        self.odom_frame = ""
        self._waiting: deque[Picture] = deque()
        self._tf = TransformListener(node)
        self.forget_camera()
        profile = DEEP if params.every_image else qos.SENSOR
        node.add_subscription("camera_info", CameraInfo, self._on_info, profile)
        if params.transport == "raw":
            node.add_subscription("image_raw", Image, self._on_image, profile)
        else:
            node.add_subscription("image_raw/compressed", CompressedImage, self._on_image, profile)
        if params.use_odometry:
            node.add_subscription("odom", Odometry, self._on_odometry, qos.SENSOR, is_required=False)

    def forget_camera(self) -> None:
        """Take the next calibration and transform for new ones."""
        self.camera: Camera | None = None
        self._T_base_camera: SE3 | None = None
        self._fault = Finding(Reason.BAD_INFO, detail="no camera_info yet")

    @property
    def T_base_camera(self) -> SE3:
        """The camera on the base, optical axes; identity before it is known."""
        return self._T_base_camera or SE3.identity()

    @property
    def is_mounted(self) -> bool:
        """Whether it is known where the camera is on the base."""
        return self._T_base_camera is not None

    def T_odom_camera(self, stamp_ns: int) -> SE3 | None:
        """Return odometry of the camera at a stamp."""
        T_odom_base = self.odometry.at(stamp_ns)
        return T_odom_base @ self.T_base_camera if T_odom_base is not None else None

    def _on_info(self, message: CameraInfo) -> None:
        try:
            self.camera = conversions.camera_from_info(message, is_rectified=self._params.is_rectified)
        except ValueError as error:
            self.camera, self._fault = None, Finding(Reason.BAD_INFO, detail=str(error))
            self._hand_on(patience=0)
            raise
        self._hand_on(self._params.max_waiting)

    def _on_odometry(self, message: Odometry) -> None:
        T_odom_base, twist = conversions.odometry_to_se3(message)
        self.odometry.add(conversions.stamp_ns(message), T_odom_base, twist)
        self.odom_frame = message.header.frame_id

    def _on_image(self, message: Picture) -> None:
        self._waiting.append(message)
        is_refused = self.camera is None and "no camera_info" not in self._fault.detail
        self._hand_on(0 if is_refused else self._params.max_waiting)

    def _hand_on(self, patience: int) -> None:
        """Hand on all images that are ready, and those that have waited for more than `patience` others."""
        while self._waiting:
            fault = self._what_is_missing(self._waiting[0])
            if fault.reason is not Reason.NONE and len(self._waiting) <= patience:
                return
            self._deliver(self._waiting.popleft(), fault)

    def _what_is_missing(self, message: Picture) -> Finding:
        if self.camera is None:
            return self._fault
        base, frame = self._params.base_frame, self._params.camera_frame or message.header.frame_id
        if self._T_base_camera is None:
            try:
                self._T_base_camera = self._tf.lookup(base, frame) if base and frame != base else SE3.identity()
            except ValueError as error:
                return Finding(Reason.TF_STALE, detail=str(error))
        return FINE
