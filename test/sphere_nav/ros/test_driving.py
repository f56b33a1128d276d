"""Commands, scans and trajectories against their messages."""

import math

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from path_follower.params import FollowerParams
from path_follower.taught import Given, make_path
from sphere_nav.ros.conversions import driving, stamp_ns

STAMP = 1_700_000_000_123_456_789


def test_a_twist_is_speed_and_yaw_rate_of_the_rear_axle():
    twist = driving.motion_to_command(1.2, -0.3, STAMP, "base_link", is_stamped=False)
    assert (twist.linear.x, twist.angular.z) == (1.2, -0.3)
    assert (twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y) == (0, 0, 0, 0)
    stamped = driving.motion_to_command(1.2, -0.3, STAMP, "base_link", is_stamped=True)
    assert (stamp_ns(stamped), stamped.header.frame_id, stamped.twist) == (STAMP, "base_link", twist)


@pytest.mark.skipif(driving.AckermannDriveStamped is None, reason="ackermann_msgs is not installed")
def test_an_ackermann_command_is_speed_and_angle_of_the_front_wheel():
    message = driving.motion_to_ackermann(1.2, 0.25, STAMP, "base_link")
    assert (message.drive.speed, message.drive.steering_angle) == pytest.approx((1.2, 0.25))


def scan(ranges, **fields):
    usual = {"angle_min": -math.pi / 2, "angle_increment": math.pi / 2, "range_min": 0.1, "range_max": 30.0}
    usual["angle_max"] = usual["angle_min"] + usual["angle_increment"] * (len(ranges) - 1)
    return LaserScan(ranges=[float(r) for r in ranges], **(usual | fields))


def test_beams_become_points_and_those_without_a_hit_none_though_a_free_one_is_a_measurement():
    np.testing.assert_allclose(driving.scan_to_points(scan([2, 3, 4])), [[0, -2, 0], [3, 0, 0], [0, 4, 0]], atol=1e-6)
    assert driving.scan_to_points(scan([math.nan, math.inf, 0.05])).shape == (0, 3)
    assert driving.scan_to_points(scan([31.0, 3.0, -1.0])).shape == (1, 3)
    ranges = [math.inf, 31.0, 30.0, 0.1001, 0.05, 0.0, -1.0, -math.inf, math.nan]
    assert driving.measured_beams(scan(ranges)).tolist() == [True] * 4 + [False] * 5
    assert driving.measured_beams(scan([0.0, 1.0], range_min=0.0)).tolist() == [False, True]


def test_a_scan_without_beams_or_whose_numbers_contradict_each_other_is_refused_by_name():
    for fields, name in [
        ({"angle_increment": math.nan}, "finite"),
        ({"range_min": 30.0}, "range_min, range_max"),
        ({"angle_increment": -math.pi / 18}, "angle_increment"),
        ({"angle_increment": 0.8, "angle_max": 0.8 * 9 - math.pi / 2}, "angle_increment"),
    ]:
        message = scan([2.0] * 10, **{"angle_increment": math.pi / 18, "angle_max": 0.0} | fields)
        with pytest.raises(ValueError, match=f"scan: .*{name}"):
            driving.scan_to_points(message)
    with pytest.raises(ValueError, match="scan: ranges: expected 1 to"):
        driving.scan_to_points(scan([]))


def test_scanners_that_count_the_last_beam_or_do_not_or_turn_the_other_way_are_none_of_these():
    for end in [359, 360, 361]:
        for step in [math.pi / 180, -math.pi / 180]:
            message = scan([2.0] * 360, angle_min=0.0, angle_max=end * step, angle_increment=step)
            assert driving.scan_to_points(message)[90] == pytest.approx([0.0, math.copysign(2.0, step), 0.0], abs=1e-5)


def test_frames_are_checked():
    message = Odometry(child_frame_id="wheel")
    message.header.frame_id = "odom"
    driving.check_frames(message, "odom", "wheel")
    with pytest.raises(ValueError, match=r"header\.frame_id: expected 'map', found 'odom'"):
        driving.check_frames(message, "map")
    with pytest.raises(ValueError, match="child_frame_id: expected 'base_link', found 'wheel'"):
        driving.check_frames(message, "odom", "base_link")


def test_a_trajectory_backwards_is_one_that_reverses():
    points = np.stack([-np.arange(0, 8, 0.1), np.zeros(80)], axis=-1)
    path = make_path(Given(points, np.zeros(80), map_id="yard"), FollowerParams())
    message = driving.trajectory_to_message(path, STAMP, "map")
    assert message.map_id == "yard"
    assert message.length == pytest.approx(7.9)
    np.testing.assert_allclose([point.speed for point in message.points], path.speed)


def test_a_scan_in_millimetres_is_told_and_one_without_a_limit_is_read():
    scan = LaserScan(angle_min=-1.0, angle_max=1.0, angle_increment=0.02, range_min=0.1, range_max=math.inf)
    scan.ranges = [2.5] * 101
    assert len(driving.scan_to_points(scan)) == 101
    scan.ranges = [2500.0] * 60 + [math.inf] * 41
    with pytest.raises(ValueError, match=r"scan: ranges: median: expected metres, .* found 2500: .*factor 0.001"):
        driving.check_scan(scan)
    scan.range_max = math.nan
    with pytest.raises(ValueError, match="scan: expected finite angles and range limits"):
        driving.check_scan(scan)
