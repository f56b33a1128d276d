"""What the localiser publishes: pose, odometry, transform, status, and the residual image for whoever looks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from sphere_nav_msgs.msg import LocalizationStatus

from dense_localizer.localizer import Estimate
from dense_localizer.residual import residual_image
from localization.status import TRUSTED, State, Status, describe
from node_kit import conversions, qos
from node_kit.node import ERROR, OK, WARN
from node_kit.tf import TransformBroadcaster
from sphere_geometry import SE3, Camera

if TYPE_CHECKING:
    from dense_localizer.node import DenseLocalizerNode

UNKNOWN_TWIST = np.diag(np.full(6, 1e6))  # variance of a velocity that nobody measured


class Outputs:
    """Converts estimates of the camera to messages about the base. What is not trusted is not published."""

    def __init__(self, node: DenseLocalizerNode) -> None:
        self._node = node
        self._pose = node.add_publisher("pose", PoseWithCovarianceStamped, qos.STATE)
        self._odometry = node.add_publisher("odometry", Odometry, qos.STATE)
        self._status = node.add_publisher("status", LocalizationStatus, qos.STATE)
        self._residual = node.add_publisher("residual", Image, qos.LARGE)
        self._tf = TransformBroadcaster(node)
        self._told = ""
        self.state = State.UNCONFIGURED  # last told

    def publish(self, estimate: Estimate, milliseconds: float) -> None:
        """Publish what an image led to; the status comes last, so that who waits for it has the pose."""
        if estimate.T_map_camera is not None and estimate.covariance is not None:
            self._publish_pose(estimate, estimate.T_map_camera, estimate.covariance)
        self.tell(replace(estimate.status, milliseconds=milliseconds))

    def show(self, estimate: Estimate, image: NDArray[Any], camera: Camera) -> None:
        """Publish the residual image, if anyone looks."""
        if estimate.place is not None and self._residual.num_subscriptions:
            picture = residual_image(image, camera, estimate.place)
            stamp, frame = estimate.status.stamp_ns, self._node.params.camera_frame
            self._residual.publish(conversions.array_to_image(picture, stamp, frame, "mono8"))

    def tell(self, status: Status) -> None:
        """Publish a status; report it to the diagnostics; log every change of state or reason."""
        self.state = status.state
        self._status.publish(conversions.status_to_message(status, status.stamp_ns, self._node.params.map_frame))
        level = OK if status.state is State.TRACKING else WARN if status.state in TRUSTED else ERROR
        text = describe(status)
        values = {"quality": status.quality, "overlap": status.overlap, "inlier_share": status.inlier_share}
        self._node.report("localisation", level, text, **values, milliseconds=status.milliseconds, age=status.age)
        change = f"{status.state} {status.reason}"
        if change != self._told:
            (self._node.log.info if level == OK else self._node.log.warning)(text)
        self._told = change

    def _publish_pose(self, estimate: Estimate, T_map_camera: SE3, covariance: NDArray[np.float64]) -> None:
        params, stamp = self._node.params, estimate.status.stamp_ns
        T_base_camera = self._node.intake.T_base_camera
        T_map_base = T_map_camera @ T_base_camera.inverse()
        in_base = conversions.moved_covariance(covariance, T_base_camera)
        twist, twist_covariance = np.zeros(6), UNKNOWN_TWIST
        if estimate.velocity is not None and estimate.velocity_covariance is not None:
            twist = T_base_camera.adjoint() @ estimate.velocity
            twist_covariance = conversions.moved_covariance(estimate.velocity_covariance, T_base_camera)
        frames = params.map_frame, params.base_frame or params.camera_frame
        self._node.companion.add_own(stamp, T_map_base, in_base)
        self._pose.publish(conversions.se3_to_pose_with_covariance(T_map_base, in_base, stamp, params.map_frame))
        message = conversions.se3_to_odometry(T_map_base, in_base, stamp, frames, twist, twist_covariance)
        self._odometry.publish(message)
        if params.publish_tf:
            self._publish_tf(T_map_base, stamp, frames)

    def _publish_tf(self, T_map_base: SE3, stamp: int, frames: tuple[str, str]) -> None:
        """Tell map -> odom where odom -> base is somebody else's, else map -> base (REP-105)."""
        intake = self._node.intake
        if not intake.odom_frame:
            self._tf.send(T_map_base, stamp, *frames)
            return
        T_odom_base = intake.odometry.at(stamp)
        if T_odom_base is not None:
            ahead = stamp + int(1e8)
            self._tf.send(T_map_base @ T_odom_base.inverse(), ahead, frames[0], intake.odom_frame)
