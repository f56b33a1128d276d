"""The base that follower processes drive, which says where it is."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import se3_to_pose_with_covariance, status_to_message

PERIOD = 0.1  # s between two poses
PATIENCE = 240.0  # s for a follower to come up and drive, on a busy machine
SETTLE = 1.0  # s for what keeps the machine busy to find the follower
CRUISE = 1.4  # m/s


class Base:
    """Says where it is, and obeys the last command."""

    def __init__(self, remap: str = "cmd_vel") -> None:
        self.node = rclpy.create_node("base")
        self.node.create_subscription(Twist, remap, self._obey, qos.COMMAND)
        self.node.create_subscription(FollowerStatus, "path_follower/status", self._hear, qos.STATE)
        self.poses = self.node.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
        self.states = self.node.create_publisher(LocalizationStatus, "status", qos.STATE)
        self.button = self.node.create_publisher(Bool, "emergency_stop", qos.SENSOR)
        self.scans = self.node.create_publisher(LaserScan, "scan", qos.SENSOR)
        self.start, self.request = self.node.create_client(Trigger, "path_follower/start"), Trigger.Request()
        self.x = self.speed = self.worst_cycle = 0.0
        self.commands: list[tuple[float, float]] = []
        self.reason, self.state = "", "TRACKING"
        self.frame, self.value, self.is_silent, self.has_status = "map", 0.0, False, True
        self.is_pressed = False
        self.others: list[Any] = []
        self._due = self._told = time.monotonic()

    def _obey(self, message: Any) -> None:
        self.speed = message.linear.x
        self.commands.append((time.monotonic(), self.speed))

    def _hear(self, message: Any) -> None:
        self.reason = message.reason or self.reason
        self.worst_cycle = max(self.worst_cycle, message.worst_cycle)

    def live(self, seconds: float, is_done: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass until something is done; whether it was."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not is_done():
            if time.monotonic() >= self._due:
                self._due += PERIOD
                self._due = max(self._due, time.monotonic() - PERIOD)
                self.speak()
            rclpy.spin_once(self.node, timeout_sec=max(min(self._due, end) - time.monotonic(), 0.001))
        return is_done()

    def place(self) -> Any:
        """Return where the base is."""
        return SE3.from_planar(self.x, 0.0, 0.0)

    def speak(self) -> None:
        """Say where the base is, how the localiser is, and that the button is as it is."""
        stamp = self.node.get_clock().now().nanoseconds
        now = time.monotonic()
        self.x += self.speed * (now - self._told)  # a car that is late to say it has moved, too
        self._told = now
        self.button.publish(Bool(data=self.is_pressed))
        if self.has_status:
            self.states.publish(status_to_message(Status(State(self.state)), stamp, "map"))
        if not self.is_silent:
            message = se3_to_pose_with_covariance(self.place(), 1e-4 * np.eye(6), stamp, self.frame)
            message.pose.pose.position.y = self.value
            self.poses.publish(message)

    def drive_off(self, speed: float = 0.95 * CRUISE) -> None:
        """Start, again and again, until it drives as fast as that."""
        answer: Any = None
        asked = 0.0

        def is_driving() -> bool:
            nonlocal answer, asked
            if time.monotonic() - asked > 1.0 and self.start.service_is_ready() and self.speed == 0.0:
                answer, asked = self.start.call_async(self.request), time.monotonic()
            return self.speed > speed

        if not self.live(PATIENCE, is_driving):
            why = answer.result() if answer is not None and answer.done() else answer
            raise RuntimeError(f"path_follower: expected it to drive, found {self.reason!r}, start: {why}")
