"""Real processes over real DDS: a follower that is killed or stopped behind a guard, and a pose from two sources."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus
from std_srvs.srv import Trigger

from architecture.tree import EXECUTABLES
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import se3_to_pose_with_covariance, status_to_message

PERIOD = 0.04  # s between two poses
PATIENCE = 25.0  # s of a loaded machine


def process(executable, *arguments):
    code = f"import sys; from {EXECUTABLES[executable]} import main; sys.exit(main())"
    return subprocess.Popen([sys.executable, "-c", code, "--ros-args", *arguments])


class Vehicle:
    """Where it is, it says itself; it does what the guard lets through."""

    def __init__(self):
        self.node = rclpy.create_node("vehicle")
        self.x = self.speed = 0.0
        self.reason, self.asked, self.answer = "", 0.0, None
        self.node.create_subscription(Twist, "cmd_vel", self.obey, qos.COMMAND)
        self.node.create_subscription(FollowerStatus, "path_follower/status", self.hear, qos.STATE)
        self.poses = self.node.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
        self.states = self.node.create_publisher(LocalizationStatus, "status", qos.STATE)
        self.start = self.node.create_client(Trigger, "path_follower/start")
        self.calls = [self.start, self.start, self.node.create_client(Trigger, "path_follower/stop")]

    def obey(self, message):
        self.speed = message.linear.x

    def hear(self, message):
        self.reason = message.reason

    def live(self, seconds, is_done=lambda: False):
        """Let time pass until something is done; whether it was."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not is_done():
            stamp = self.node.get_clock().now().nanoseconds
            self.states.publish(status_to_message(Status(State.TRACKING), stamp, "map"))
            self.poses.publish(pose(self.x, stamp))
            until = time.monotonic() + PERIOD
            while (left := until - time.monotonic()) > 0:
                rclpy.spin_once(self.node, timeout_sec=left)
            self.x += self.speed * PERIOD
        return is_done()

    def drive_off(self):
        """Start; stop and start again where the guard came too late to see a zero command first."""

        def is_driving():
            if time.monotonic() - self.asked > 1.0 and self.start.service_is_ready():
                self.asked = time.monotonic()
                self.calls += [self.calls.pop(0)]
                self.answer = self.calls[-1].call_async(Trigger.Request())
            return self.speed > 0.4

        is_off = self.live(PATIENCE, is_driving)
        answer = self.answer and self.answer.result()
        assert is_off, f"at {self.speed}, {self.reason!r}, start {self.start.service_is_ready()}, answer {answer}"


def pose(x, stamp):
    return se3_to_pose_with_covariance(SE3.from_planar(x, 0.0, 0.0), 1e-4 * np.eye(6), stamp, "map")


@pytest.fixture
def drive(tmp_path):
    """A vehicle that drives, and the process of its follower."""
    (tmp_path / "path.csv").write_text("\n".join(f"{x},0" for x in range(100)))
    follower = process("path_follower", "-p", f"trajectory:={tmp_path / 'path.csv'}", "-r", "cmd_vel:=cmd_vel_in")
    guard = process("command_guard")
    rclpy.init()
    vehicle = Vehicle()
    try:
        vehicle.drive_off()
        yield vehicle, follower
    finally:
        vehicle.node.destroy_node()
        rclpy.try_shutdown()
        for child in (follower, guard):
            child.kill()
            child.wait(5.0)


def zero_within(vehicle, seconds):
    return vehicle.live(seconds, lambda: vehicle.speed == 0.0)


def test_a_follower_that_is_killed_leaves_the_base_at_zero(drive):
    vehicle, follower = drive
    follower.kill()
    assert zero_within(vehicle, 2.0)  # 0.25 s and the ramp of 0.3 s on an idle machine
    vehicle.live(0.3)
    assert vehicle.speed == 0.0


def test_a_follower_that_is_stopped_leaves_the_base_at_zero_and_does_not_go_on_by_itself(drive):
    vehicle, follower = drive
    follower.send_signal(signal.SIGSTOP)
    assert zero_within(vehicle, 2.0)
    follower.send_signal(signal.SIGCONT)
    vehicle.live(1.0)
    assert vehicle.speed == 0.0


def test_a_second_publisher_of_the_pose_is_named_and_stops(drive):
    vehicle, _ = drive
    other = rclpy.create_node("other_localizer")
    publisher = other.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
    assert zero_within(vehicle, 3.0)
    assert vehicle.live(2.0, lambda: vehicle.reason == "POSE_SOURCE")
    other.destroy_publisher(publisher)
    other.destroy_node()
    vehicle.drive_off()  # by the call start
