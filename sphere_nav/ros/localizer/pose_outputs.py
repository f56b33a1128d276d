"""What a localiser publishes: pose, odometry, transform and status; its state goes to the diagnostics and the log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sphere_nav_msgs.msg import LocalizationStatus

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import TRUSTED, BaseEstimate, State, Status, describe_status
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.constants import LOG_PERIOD_S
from sphere_nav.ros.endpoints import ERROR, OK, WARN, Endpoints
from sphere_nav.ros.localizer.map_transform import MapTransform

UNKNOWN_TWIST = np.diag(np.full(6, 1e6))  # variance of a velocity that nobody measured
REPORT = "localisation"


class PoseOutputs:
    """Converts estimates to messages. What is not trusted is not published."""

    def __init__(
        self,
        endpoints: Endpoints,
        params: NodeParams,
        odometry: OdometryInput,
        map_id: Callable[[], str],
    ) -> None:
        """`map_id` returns that of the map in use, empty where it is not known."""
        self._endpoints, self._params = endpoints, params
        self._pose = endpoints.add_publisher("pose", PoseWithCovarianceStamped, qos.STATE)
        self._odometry = endpoints.add_publisher("odometry", Odometry, qos.STATE)
        self._status = endpoints.add_publisher("status", LocalizationStatus, qos.STATE)
        self._frames = params.map_frame, params.base_frame or params.camera_frame
        self._transform = MapTransform(endpoints, odometry, *self._frames) if params.publish_tf else None
        self.state = State.UNCONFIGURED  # last told
        self._map_id = map_id

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        if self._transform is not None:
            self._transform.clear()

    def publish(self, estimate: BaseEstimate) -> None:
        """Publish what an image led to; the status comes last, so that who waits for it has the pose."""
        if estimate.T_map_base is not None and estimate.covariance is not None:
            self._publish_pose(estimate, estimate.T_map_base, estimate.covariance)
        self.tell(estimate.status)

    def tell(self, status: Status) -> None:
        """Publish a status; report it to the diagnostics; log changes of state or reason."""
        self.state, status = status.state, replace(status, map_id=self._map_id())
        if self._transform is not None and status.state not in TRUSTED:
            self._transform.stop()
        self._status.publish(conversions.status_to_message(status, status.stamp_ns, self._params.map_frame))
        level = WARN if status.state in TRUSTED else ERROR
        if status.state is State.TRACKING and not status.reason:
            level = OK
        text = describe_status(status)
        self._endpoints.tell(REPORT, level, text, f"{status.state} {status.reason}", every=LOG_PERIOD_S)

    def _publish_pose(self, estimate: BaseEstimate, T_map_base: SE3, covariance: Array) -> None:
        stamp = estimate.status.stamp_ns
        twist, twist_covariance = estimate.velocity, estimate.velocity_covariance
        if twist is None or twist_covariance is None:
            twist, twist_covariance = np.zeros(6), UNKNOWN_TWIST
        pose = conversions.se3_to_pose_with_covariance(T_map_base, covariance, stamp, self._frames[0])
        self._pose.publish(pose)
        way = covariance if estimate.odometry_covariance is None else estimate.odometry_covariance
        odometry = conversions.se3_to_odometry(T_map_base, way, stamp, self._frames, twist, twist_covariance)
        self._odometry.publish(odometry)
        if self._transform is not None:
            self._transform.update(T_map_base, stamp)
