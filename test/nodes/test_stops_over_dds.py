"""Real processes over real DDS: a follower that is killed or stopped behind a guard, and a pose from two sources."""

import signal

import pytest
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped

from sphere_nav.ros import qos
from worlds.base import Base, start, straight

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A vehicle behind a guard, and the process of its follower."""
    words = straight(tmp_path_factory.mktemp("path"))
    running = [start("path_follower", *words, "-r", "cmd_vel:=cmd_vel_in"), start("command_guard")]
    vehicle = Base()
    yield vehicle, running[0]
    vehicle.close()
    for child in running:
        child.kill()
        child.wait(120.0)


def stands(vehicle):
    """Whether it comes to zero, and stays there."""
    return vehicle.live(60.0, lambda: vehicle.speed == 0.0) and not vehicle.live(1.0, lambda: vehicle.speed != 0.0)


def test_a_second_publisher_of_the_pose_is_named_and_stops(drive):
    vehicle, _ = drive
    vehicle.drive_off(0.3)
    other = rclpy.create_node("other_localizer")
    other.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
    assert stands(vehicle)
    assert vehicle.reason == "POSE_SOURCE"
    other.destroy_node()


def test_a_follower_that_is_stopped_leaves_the_base_at_zero_and_does_not_go_on_by_itself(drive):
    vehicle, follower = drive
    vehicle.drive_off(0.3)  # by the call start, which lets the guard pass commands again, too
    follower.send_signal(signal.SIGSTOP)
    assert stands(vehicle)
    follower.send_signal(signal.SIGCONT)
    assert stands(vehicle)


def test_a_follower_that_is_killed_leaves_the_base_at_zero(drive):
    vehicle, follower = drive
    vehicle.drive_off(0.3)
    follower.kill()
    assert stands(vehicle)
