"""A base over real DDS: says where it is, and obeys the last command of a follower in a process of its own."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from architecture.tree import EXECUTABLES
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import se3_to_pose_with_covariance, status_to_message

from .patience import Patience

ANSWER_S = 5.0  # for the answer to a request
PERIOD = 0.1  # s between two poses
CRUISE = 1.4  # m/s


def start(executable, *arguments):
    """Start a node as a process."""
    code = f"import sys; from {EXECUTABLES[executable]} import main; sys.exit(main())"
    return subprocess.Popen([sys.executable, "-c", code, "--ros-args", *arguments])


def straight(folder):
    """Return the words that give a follower 400 m of a straight path, and patience with poses that come late."""
    (folder / "path.csv").write_text("\n".join(f"{x},0" for x in range(400)))
    late = [f"safety.{name}:=5.0" for name in ("max_pose_silence", "max_blind_time", "max_status_silence")]
    return [part for word in (f"trajectory:={folder / 'path.csv'}", *late) for part in ("-p", word)]


def children(pid):
    """Return the processes that a process has started."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_running(pid):
    """Whether a process is neither gone nor only waited for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


class Base:
    """The base, its localiser and its button, and what they say."""

    patience = Patience
    state, has_status, is_silent = "TRACKING", True, False  # of the localiser; its status and its pose
    frame, aside = "map", 0.0  # of the pose; how far it is off, m
    worst_cycle = 0.0

    def __init__(self, button=qos.SENSOR):
        rclpy.init()
        self.node = rclpy.create_node("base")
        self.node.create_subscription(Twist, "cmd_vel", self._obey, qos.COMMAND)
        self.node.create_subscription(FollowerStatus, "path_follower/status", self._hear, qos.STATE)
        self.poses = self.node.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
        self.states = self.node.create_publisher(LocalizationStatus, "status", qos.STATE)
        self.button = self.node.create_publisher(Bool, "emergency_stop", button)
        self.start = self.node.create_client(Trigger, "path_follower/start")
        self.x, self.speed, self.reason, self.answer = 0.0, 0.0, "", ""
        self.commands, self.is_pressed, self.is_button_silent = [], False, False
        self.held_up_s = 0.0  # the longest that this process itself was kept from listening
        self._due = self._told = self._asked = time.monotonic()
        self._call = None

    def close(self):
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _obey(self, message):
        self.speed = message.linear.x
        self.commands.append((time.monotonic(), self.speed))

    def _hear(self, message):
        self.reason = message.reason or self.reason
        self.worst_cycle = max(self.worst_cycle, message.worst_cycle)

    def live(self, seconds, is_done=lambda: False):
        """Let time pass until something is done; whether it was."""
        patience = self.patience(seconds)
        while patience.is_left() and not is_done():
            begun = time.monotonic()
            if begun >= self._due:
                self._due = max(self._due + PERIOD, begun)
                self.speak()
            rclpy.spin_once(self.node, timeout_sec=max(self._due - time.monotonic(), 0.001))
            self.held_up_s = max(self.held_up_s, time.monotonic() - begun - PERIOD)
        return is_done()

    def place(self):
        """Return where the base is."""
        return SE3.from_planar(self.x, 0.0, 0.0)

    def speak(self):
        """Say where the base is, how it is localised, and that the button is as it is."""
        stamp, now = self.node.get_clock().now().nanoseconds, time.monotonic()
        self.x, self._told = self.x + self.speed * (now - self._told), now  # what is late to say it has moved, too
        if not self.is_button_silent:
            self.button.publish(Bool(data=self.is_pressed))
        if self.has_status:
            self.states.publish(status_to_message(Status(State(self.state)), stamp, "map"))
        if not self.is_silent:
            message = se3_to_pose_with_covariance(self.place(), 1e-4 * np.eye(6), stamp, self.frame)
            message.pose.pose.position.y += self.aside
            self.poses.publish(message)

    def ask(self):
        """Ask for the drive once a second, again where no answer comes: DDS may lose one. Keep the last answer."""
        if self._call is not None and self._call.done():
            self.answer, self._call = self._call.result().message, None
        if self._call is not None and time.monotonic() - self._asked > ANSWER_S:
            self.start.remove_pending_request(self._call)
            self._call = None
        if self._call is None and time.monotonic() - self._asked > 1.0 and self.start.service_is_ready():
            self._call, self._asked = self.start.call_async(Trigger.Request()), time.monotonic()

    def drive_off(self, speed=0.95 * CRUISE):
        """Ask for the drive until it drives as fast as that."""

        def is_driving():
            if self.speed == 0.0:
                self.ask()
            return self.speed > speed

        assert self.live(240.0, is_driving), f"{self.reason!r}, start: {self.answer!r}"
