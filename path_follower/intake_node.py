"""What the vehicle is driven by: poses and the localiser's status, or directions and what their source says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus

from node_kit import conversions, qos
from node_kit.conversions import driving
from node_kit.tf import TransformListener
from path_follower.homing import HomingFollower
from path_follower.modes import State
from path_follower.path import Pose2
from path_follower.safety import DEGRADED, TRUSTED

if TYPE_CHECKING:
    from path_follower.node import PathFollowerNode


class Intake:
    """Gives the follower what it needs, and lets the node answer."""

    def __init__(self, node: PathFollowerNode) -> None:
        self.node, p = node, node.params
        self.tf = TransformListener(node)
        if isinstance(node.follower, HomingFollower):
            node.add_subscription("homing/direction", PoseStamped, self.on_direction, qos.STATE)
            node.add_subscription("homing/status", FollowerStatus, self.on_source, qos.STATE)
        else:
            if p.source == "pose":
                node.add_subscription("pose", PoseWithCovarianceStamped, self.on_pose, qos.STATE)
            else:
                node.add_subscription("odometry", Odometry, self.on_odometry, qos.STATE)
            needed = p.safety.is_status_required
            node.add_subscription("status", LocalizationStatus, self.on_status, qos.STATE, is_required=needed)
        node.add_subscription("scan", LaserScan, self.on_scan, qos.SENSOR, is_required=p.safety.is_scan_required)

    def on_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Answer a pose of base_link in the map."""
        self.answer(message, lambda: conversions.pose_with_covariance_to_se3(message, self.node.params.map_frame)[0])

    def on_odometry(self, message: Odometry) -> None:
        """Answer an odometry: pose of base_link in the map, and its speed."""
        driving.check_frames(message, self.node.params.map_frame, self.node.params.base_frame)
        T_map_base, twist = conversions.odometry_to_se3(message)
        self.answer(message, lambda: T_map_base, float(twist[0]))

    def answer(self, message: Any, convert: Any, speed: float | None = None) -> None:
        """Update the follower with a pose and publish its command, with the stamp of the pose."""
        node, stamp = self.node, conversions.stamp_ns(message)
        try:
            pose = Pose2.of(convert())
        except ValueError:
            node.follower.watch.is_pose_bad = True  # brake, whatever is wrong with it
            raise
        node.publish(node.follower.update(pose, speed, stamp, now_ns=node.hear(stamp)), stamp)

    def on_status(self, message: LocalizationStatus) -> None:
        """Take the state of the localiser; without a pose to come for this image the answer is given here."""
        node, status, stamp = self.node, conversions.message_to_status(message), conversions.stamp_ns(message)
        now = max(node.now_ns(), stamp)
        node.follower.watch.see_status(status.state, now)
        if status.state not in (TRUSTED, DEGRADED) and stamp > node.answered_ns:
            node.publish(node.follower.tick(node.hear(stamp)), stamp)

    def on_direction(self, message: PoseStamped) -> None:
        """Answer a direction: x of the pose, seen from base_link."""
        node, stamp = self.node, conversions.stamp_ns(message)
        assert isinstance(node.follower, HomingFollower)
        driving.check_frames(message, node.params.base_frame)
        node.follower.see(float(conversions.pose_to_se3(message.pose).yaw), stamp)
        node.publish(node.follower.tick(node.hear(stamp)), stamp)

    def on_source(self, message: FollowerStatus) -> None:
        """Take whether the directions may be followed; where none is to come the answer is given here."""
        node, stamp = self.node, conversions.stamp_ns(message)
        state, way = driving.message_to_progress(message)
        assert isinstance(node.follower, HomingFollower)
        is_trusted, is_there = state == State.DRIVING, state == State.FINISHED
        now = max(node.now_ns(), stamp)
        node.follower.see_source(is_trusted=is_trusted, is_there=is_there, way=way, now_ns=now)
        if not is_trusted and stamp > node.answered_ns:
            node.publish(node.follower.tick(node.hear(stamp)), stamp)

    def on_scan(self, message: LaserScan) -> None:
        """Take the obstacles of a scan, seen from base_link."""
        T_base_scan = self.tf.lookup(self.node.params.base_frame, message.header.frame_id)
        points = T_base_scan.apply(driving.scan_to_points(message))
        self.node.follower.watch.see_scan(points[:, :2], self.node.now_ns())
