"""Real processes over real DDS: a follower that is killed or stopped behind a guard, and a pose from two sources."""

import signal
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped

from architecture.tree import EXECUTABLES
from benchmarks.fault_processes import DRIVING, Base
from sphere_nav.ros import qos

pytestmark = pytest.mark.dds


def process(executable, *arguments):
    code = f"import sys; from {EXECUTABLES[executable]} import main; sys.exit(main())"
    return subprocess.Popen([sys.executable, "-c", code, "--ros-args", *arguments])


@pytest.fixture
def drive(tmp_path):
    """A vehicle that drives, and the process of its follower."""
    (tmp_path / "path.csv").write_text("\n".join(f"{x},0" for x in range(100)))
    follower = process("path_follower", "-p", f"trajectory:={tmp_path / 'path.csv'}", "-r", "cmd_vel:=cmd_vel_in")
    guard = process("command_guard")
    rclpy.init()
    vehicle = Base()
    try:
        vehicle.drive_off(DRIVING)
        yield vehicle, follower
    finally:
        vehicle.node.destroy_node()
        rclpy.try_shutdown()
        for child in (follower, guard):
            child.kill()
            child.wait(120.0)


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
    vehicle.drive_off(DRIVING)  # by the call start
