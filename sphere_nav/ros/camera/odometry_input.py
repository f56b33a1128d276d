"""Where odometry says that the base is: the topic `odom`, and what others publish above the base on /tf."""

from __future__ import annotations

from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile

from sphere_nav.geometry import SE3
from sphere_nav.geometry.odometry import OdometryBuffer
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.clocks import check_stamp
from sphere_nav.ros.constants import MAX_ODOMETRY_AGE_NS
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.tf import TransformError, TransformTree


def is_truth(name: str) -> bool:
    """Whether a topic or a frame says that it is the truth."""
    return "truth" in name


def odometry_edge(tree: TransformTree, base_frame: str, map_frame: str = "") -> tuple[str, str] | None:
    """Return the two frames by which /tf tells odometry: what moves next above the base; None: truth, map, nothing."""
    edge = tree.moving_edge(base_frame)
    return None if edge is None or edge[0] == map_frame or is_truth(edge[0]) else edge


class OdometryInput:
    """Odometry of the base from one source, whose frame does not change."""

    def __init__(
        self,
        endpoints: Endpoints,
        tree: TransformTree,
        base_frame: str,
        profile: QoSProfile = qos.SENSOR,
    ) -> None:
        """`tree` is asked where no topic `odom` is heard; it must not know the map."""
        self._endpoints, self._tree, self._base_frame = endpoints, tree, base_frame
        self._buffer, self._topic_frame = OdometryBuffer(), ""
        self._topic = endpoints.add_subscription("odom", Odometry, self._on_odometry, profile, is_required=False)

    def clear(self) -> None:
        """Forget what has a stamp."""
        self._buffer.clear()

    def reset(self) -> None:
        """Forget everything: the next odometry may be of another frame."""
        self._buffer.clear()
        self._topic_frame = ""

    @property
    def frame(self) -> str:
        """Frame that the base moves in: the one that /tf has above it, else that of the topic, else none."""
        return self._tree.root(self._base_frame) if self.is_on_tf else self._topic_frame

    @property
    def is_on_tf(self) -> bool:
        """Whether somebody publishes on /tf how the base moves."""
        return self._tree.moving_edge(self._base_frame) is not None

    @property
    def T_root_base(self) -> tuple[SE3, str]:
        """The base in the frame that is rigidly above it all, such as base_footprint, and the name of that."""
        root = self._tree.root(self._base_frame)
        return (SE3.identity() if root == self._base_frame else self._tree.lookup(root, self._base_frame)), root

    def at(self, stamp_ns: int) -> SE3 | None:
        """Return T_odom_base by the topic, with all that has come of it."""
        self._endpoints.take_waiting(self._topic)
        return self._buffer.carry_on(stamp_ns, MAX_ODOMETRY_AGE_NS)

    def predict(self, stamp_ns: int) -> SE3 | None:
        """Return T_odom_base by the topic; where that is silent by what moves above the base on /tf."""
        edge = odometry_edge(self._tree, self._base_frame)
        if self._topic_frame or edge is None:
            return self.at(stamp_ns)
        T_odom_child = self._tree.carry_on(edge[1], stamp_ns, MAX_ODOMETRY_AGE_NS)
        return T_odom_child and T_odom_child @ self._tree.lookup(edge[1], self._base_frame)

    def in_frame(self, stamp_ns: int) -> SE3 | None:
        """Return T_frame_base: by the topic where it is of this frame, else by /tf."""
        T_odom_base = self.at(stamp_ns) if self.frame == self._topic_frame else None
        if T_odom_base is not None or not self.is_on_tf:
            return T_odom_base
        try:
            return self._tree.lookup(self.frame, self._base_frame, stamp_ns)
        except TransformError:
            return None

    def _on_odometry(self, message: Odometry) -> None:
        T_odom_base, twist = conversions.odometry_to_se3(message)
        stamp, frame = conversions.stamp_ns(message), message.header.frame_id
        check_stamp(stamp, self._endpoints.now_ns(), "odom")
        if self._topic_frame not in ("", frame):
            raise ValueError(f"odom: header.frame_id: expected {self._topic_frame!r} as before, found {frame!r}")
        if not self._buffer.add(stamp, T_odom_base, twist):
            last = self._buffer[-1][0]
            raise ValueError(f"odometry stamp: expected later than {last * 1e-9:.3f} s, found {stamp * 1e-9:.3f} s")
        self._topic_frame = frame
