"""What a localiser publishes: pose, odometry, transform and status; its state goes to the diagnostics and the log.

Its part of /tf is map -> odom where somebody publishes odom -> base, else map -> base (REP-105).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sphere_nav_msgs.msg import LocalizationStatus
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import TRUSTED, BaseEstimate, State, Status, describe_status
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.constants import BACK_NS, LOG_PERIOD_S, MAX_AHEAD_NS, ODOMETRY_PATIENCE_NS, TRANSFORM_PERIOD_S
from sphere_nav.ros.endpoints import ERROR, OK, WARN, Endpoints

UNKNOWN_TWIST = np.diag(np.full(6, 1e6))  # variance of a velocity that nobody measured
REPORT = "tf"  # of the transform, in the diagnostics


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
        self._endpoints.tell("localisation", level, text, f"{status.state} {status.reason}", every=LOG_PERIOD_S)

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


class MapTransform:
    """Says where the map is, also between images, and why it cannot."""

    def __init__(self, endpoints: Endpoints, odometry: OdometryInput, map_frame: str, base_frame: str) -> None:
        self._endpoints, self._odometry = endpoints, odometry
        self._map_frame, self._base_frame = map_frame, base_frame
        self._last_ns = 0
        self._output = endpoints.add_publisher("/tf", TFMessage, qos.TF)
        self.clear()
        endpoints.add_timer(TRANSFORM_PERIOD_S, self._on_tick)

    def clear(self) -> None:
        """Say nothing until the next pose, of whatever time."""
        self.stop()
        self._last_ns = 0

    def stop(self) -> None:
        """Say nothing until the next pose: nobody knows where the vehicle is."""
        self._pose: tuple[SE3, int] | None = None  # T_map_base and stamp that odometry has not yet been found for
        self._T_map_odom: tuple[SE3, str] | None = None  # with the name of odom
        self._lead_ns = 0  # of the stamps that are sent over the node's clock
        self._since_ns = self._endpoints.now_ns()

    def update(self, T_map_base: SE3, stamp_ns: int) -> None:
        """Send the transform of a new pose."""
        now = self._endpoints.now_ns()
        is_of_this_time = 0 <= now - stamp_ns < BACK_NS
        self._lead_ns = MAX_AHEAD_NS if is_of_this_time else stamp_ns + MAX_AHEAD_NS - now
        if not self._odometry.frame:
            T_root_base, root = self._odometry.T_root_base
            self._endpoints.tell(REPORT, OK, f"{self._map_frame} -> {root}", "")
            self._publish(T_map_base @ T_root_base.inverse(), stamp_ns, root)
            return
        if self._pose is None:
            self._since_ns = now
        self._pose = T_map_base, stamp_ns
        self._complete()
        self._send(max(now + self._lead_ns, stamp_ns + MAX_AHEAD_NS))

    def _on_tick(self) -> None:
        """Repeat the transform, stamped ahead."""
        if self._pose is not None:
            self._complete()
        self._send(self._endpoints.now_ns() + self._lead_ns)

    def _complete(self) -> None:
        """Turn the pose of the base into that of odometry's frame, once odometry of its stamp is known."""
        assert self._pose is not None
        (T_map_base, stamp_ns), frame = self._pose, self._odometry.frame
        T_odom_base = self._odometry.in_frame(stamp_ns)
        if T_odom_base is not None:
            self._T_map_odom, self._pose = (T_map_base @ T_odom_base.inverse(), frame), None
            text, level = f"{self._map_frame} -> {frame}", OK
            if not self._odometry.is_on_tf:
                text, level = f"{text}; nobody publishes {frame} -> {self._base_frame} on /tf", WARN
            self._endpoints.tell(REPORT, level, text, "")
        elif self._endpoints.now_ns() - self._since_ns > ODOMETRY_PATIENCE_NS:
            self._T_map_odom = None
            text = f"{self._map_frame} -> {frame} is not sent: no odometry at the stamps of the images"
            self._endpoints.tell(REPORT, ERROR, text, text, every=LOG_PERIOD_S)

    def _send(self, stamp_ns: int) -> None:
        if self._T_map_odom is not None and stamp_ns > self._last_ns:
            self._last_ns = stamp_ns
            T_map_odom, frame = self._T_map_odom
            self._publish(T_map_odom, stamp_ns, frame)

    def _publish(self, T_map_frame: SE3, stamp_ns: int, frame: str) -> None:
        self._output.publish(
            TFMessage(transforms=[conversions.se3_to_transform(T_map_frame, stamp_ns, self._map_frame, frame)])
        )
