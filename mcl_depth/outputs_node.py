"""What the localiser in bare geometry publishes: pose, transform, status, and its diagnostics."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from geometry_msgs.msg import PoseWithCovarianceStamped
from sphere_nav_msgs.msg import LocalizationStatus

from localization.status import TRUSTED, State, Status
from mcl_depth.belief.estimate import Estimate
from node_kit import conversions
from node_kit.node import ERROR, OK, WARN
from node_kit.tf import TransformBroadcaster
from sphere_geometry import SE3

if TYPE_CHECKING:
    from mcl_depth.node import MclDepthNode


class Outputs:
    """Converts estimates of the level camera to messages about the base. What is not trusted is not published."""

    def __init__(self, node: MclDepthNode) -> None:
        self._node = node
        self._pose = node.add_publisher("pose", PoseWithCovarianceStamped)
        self._status = node.add_publisher("status", LocalizationStatus)
        self._tf = TransformBroadcaster(node)
        self.state = State.UNCONFIGURED  # last told

    def publish(self, estimate: Estimate, stamp: int, milliseconds: float) -> None:
        """Publish what an image led to; the status comes last, so that who waits for it has the pose."""
        self._publish_pose(estimate, stamp)
        self.tell(replace(estimate.status, milliseconds=milliseconds), estimate)

    def tell(self, status: Status, estimate: Estimate | None = None) -> None:
        """Publish a status and report it, with the hit rates of the caches."""
        node, self.state = self._node, status.state
        self._status.publish(conversions.status_to_message(status, status.stamp_ns, node.params.map_frame))
        level = OK if status.state is State.TRACKING else WARN if status.state in TRUSTED else ERROR
        text = f"{status.state} {status.reason}: {status.remedy}" if status.reason else str(status.state)
        values = {"quality": status.quality, "age": status.age, "milliseconds": status.milliseconds}
        if node.filter is not None:
            cache = node.filter.map.cache
            values |= {"depth_cache_hits": cache.hit_rate, "depth_images": len(cache)}
        if estimate is not None and estimate.belief is not None:
            values["similarity_cache_hits"] = estimate.belief.comparison.hit_rate
        node.report("localisation", level, text, **values)

    def _publish_pose(self, estimate: Estimate, stamp: int) -> None:
        """Publish the pose of the base and the transform, where the pose is trusted."""
        if estimate.T_map_level is None or estimate.covariance is None:
            return
        intake, params = self._node.intake, self._node.params
        T_map_level = SE3.from_parts(estimate.T_map_level.rotation @ intake.tilt, estimate.T_map_level.translation)
        T_map_base = T_map_level @ intake.T_base_level.inverse()
        covariance = conversions.moved_covariance(estimate.covariance, intake.T_base_level)
        frame = params.map_frame
        self._node.companion.add_own(stamp, T_map_base, covariance)
        self._pose.publish(conversions.se3_to_pose_with_covariance(T_map_base, covariance, stamp, frame))
        T_odom_base = intake.odometry.at(stamp)
        if params.publish_tf and T_odom_base is not None:
            self._tf.send(T_map_base @ T_odom_base.inverse(), stamp, frame, intake.odom_frame)
        elif params.publish_tf and not intake.odom_frame:
            self._tf.send(T_map_base, stamp, frame, params.base_frame)
