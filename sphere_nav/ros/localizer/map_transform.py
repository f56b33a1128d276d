"""The localiser's part of /tf: map -> odom where somebody publishes odom -> base, else map -> base (REP-105)."""

from __future__ import annotations

from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.ros import qos
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.constants import AHEAD_NS, BACK_NS, LOG_PERIOD_S, ODOMETRY_PATIENCE_NS, TRANSFORM_PERIOD_S
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.endpoints import ERROR, OK, WARN, Endpoints

REPORT = "tf"


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
        self._lead_ns = AHEAD_NS if is_of_this_time else stamp_ns + AHEAD_NS - now
        if not self._odometry.frame:
            T_root_base, root = self._odometry.T_root_base
            self._endpoints.tell(REPORT, OK, f"{self._map_frame} -> {root}", "")
            self._publish(T_map_base @ T_root_base.inverse(), stamp_ns, root)
            return
        if self._pose is None:
            self._since_ns = now
        self._pose = T_map_base, stamp_ns
        self._complete()
        self._send(max(now + self._lead_ns, stamp_ns + AHEAD_NS))

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
        self._output.publish(TFMessage(transforms=[se3_to_transform(T_map_frame, stamp_ns, self._map_frame, frame)]))
