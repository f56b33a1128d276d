"""Commands, scans, paths and the messages of the path follower, against numbers and arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.msg import FollowerStatus, ReferencePoint, ReferenceTrajectory, TrackingError

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.plausible import check_lengths
from sphere_nav.localization.status import State
from sphere_nav.ros.conversions.headers import check_frames as check_frames
from sphere_nav.ros.conversions.headers import header
from sphere_nav.ros.conversions.status import FACTS, told, with_codes

try:
    from ackermann_msgs.msg import AckermannDriveStamped
except ImportError:  # not among the wheels, but on most vehicles
    AckermannDriveStamped = None

MAX_BEAMS = 1 << 20


def motion_to_command(speed: float, yaw_rate: float, stamp: int, frame_id: str, *, is_stamped: bool) -> Any:
    """Return a Twist of the rear-axle centre, m/s along the heading and rad/s, or a TwistStamped, stamp in ns."""
    twist = Twist()
    twist.linear.x, twist.angular.z = float(speed), float(yaw_rate)
    return TwistStamped(header=header(stamp, frame_id), twist=twist) if is_stamped else twist


def motion_to_ackermann(speed: float, steering_angle: float, stamp: int, frame_id: str) -> Any:
    """Return an AckermannDriveStamped; the angle is that of the virtual front wheel in rad, left positive."""
    message = AckermannDriveStamped(header=header(stamp, frame_id))
    message.drive.speed, message.drive.steering_angle = float(speed), float(steering_angle)
    return message


def scan_to_points(scan: LaserScan) -> Array:
    """Return the points (N, 3) in m in the scanner's frame of the beams that hit something within the range.

    ValueError for a scan whose numbers contradict each other.
    """
    check_scan(scan)
    ranges = np.asarray(scan.ranges, dtype=np.float64)
    hit = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges <= scan.range_max)
    r, a = ranges[hit], scan.angle_min + scan.angle_increment * np.flatnonzero(hit)
    return np.stack([r * np.cos(a), r * np.sin(a), np.zeros(len(r))], axis=-1)


def measured_beams(scan: LaserScan) -> Flags:
    """Return which beams (N,) measured: something in range, or nothing up to it (+Inf by REP 117, or more than it).

    NaN, -Inf, 0 and all below `range_min` are no measurement: there may be anything.
    """
    ranges = np.asarray(scan.ranges, dtype=np.float64)
    return (ranges >= scan.range_min) & (ranges > 0.0)


def check_scan(scan: LaserScan) -> None:
    """Raise ValueError for a scan whose numbers contradict each other: no beam of it can be trusted."""
    count, step, span = len(scan.ranges), float(scan.angle_increment), float(scan.angle_max) - float(scan.angle_min)
    if not 0 < count <= MAX_BEAMS:
        raise ValueError(f"scan: ranges: expected 1 to {MAX_BEAMS} beams, found {count}")
    if not np.isfinite([span, step, scan.range_min]).all() or math.isnan(scan.range_max):
        raise ValueError("scan: expected finite angles and range limits")
    if not 0.0 <= scan.range_min < scan.range_max:
        found = f"{scan.range_min:g} and {scan.range_max:g}"
        raise ValueError(f"scan: range_min, range_max: expected 0 or more, and more than that, found {found} m")
    check_lengths("scan", np.asarray(scan.ranges, dtype=np.float64), "scan: ranges")
    turn = step * (count - 1)
    if (step == 0.0 and count > 1) or abs(turn) > 1.01 * 2.0 * math.pi:
        expected = f"{count} beams within a turn, not all in one direction"
        raise ValueError(f"scan: angle_increment: expected {expected}, found {step:g} rad")
    if abs(turn - span) > 1.5 * abs(step) + 0.01 * abs(turn):  # drivers count the last beam, or do not
        expected = f"{count} beams from angle_min to angle_max, {span:g} rad"
        raise ValueError(f"scan: angle_increment: expected {expected}, found {turn:g} rad")


def follower_status_to_message(status: Any, stamp: int, frame_id: str, worst_cycle: float = 0.0) -> FollowerStatus:
    """Return the message of anything with the fields of `path_follower.modes.FollowerReport`; cycle in s."""
    message = FollowerStatus(header=header(stamp, frame_id), worst_cycle=float(worst_cycle))
    return with_codes(told(told(message, status.verdict, *FACTS), status))


def guide_status_to_message(
    advice: Any, way: tuple[float, float], min_lead: float, stamp: int, frame_id: str
) -> FollowerStatus:
    """Return whether the advice of `mcl_depth.homing` (None: there is none) may be followed; way gone and left in m."""
    message = FollowerStatus(header=header(stamp, frame_id), progress=float(way[0]), distance_to_end=float(way[1]))
    is_clear = advice is not None and advice.is_clear
    state = FollowerStatus.FINISHED if is_clear and advice.is_finished else FollowerStatus.DRIVING
    message.state, message.is_armed = state if is_clear else FollowerStatus.STOPPED, True
    if not is_clear:
        message.reason = str(State.NOT_LOCALISED)
        message.value, message.limit = float(advice.lead) if advice is not None else 0.0, float(min_lead)
        message.remedy = "the places around the next waypoint look alike, or the image cannot be used"
    return with_codes(message)


def message_to_progress(message: FollowerStatus) -> tuple[str, tuple[float, float]]:
    """Return state, and m gone and m left; ValueError for lengths that are no numbers."""
    way = float(message.progress), float(message.distance_to_end)
    if not np.isfinite(way).all():
        raise ValueError(f"progress, distance_to_end: expected finite lengths, found {way[0]:g} and {way[1]:g} m")
    return str(message.state), way


def tracking_to_message(tracking: Any, stamp: int, frame_id: str) -> TrackingError:
    """Return the message of anything with the fields of `path_follower.law.TrackingError`."""
    place, target = tracking.location, tracking.reference
    message = TrackingError(header=header(stamp, frame_id), progress=float(place.arc_length), segment=int(place.edge))
    point = ReferencePoint(position_x=float(target.x), position_y=float(target.y))
    message.reference = told(point, target)
    return told(told(message, tracking.errors), place, "cross_track")


def trajectory_to_message(path: Any, stamp: int, frame_id: str) -> ReferenceTrajectory:
    """Return the message of anything with the fields of `path_follower.path.ReferencePath`."""
    columns = (path.x, path.y, path.yaw, path.speed, path.speed * path.curvature, path.arc_length)
    names = ("position_x", "position_y", "yaw", "speed", "yaw_rate", "arc_length")
    rows = np.stack(columns, axis=-1).tolist()
    return ReferenceTrajectory(
        header=header(stamp, frame_id),
        points=[ReferencePoint(**dict(zip(names, row, strict=True))) for row in rows],
        length=float(path.length),
        map_id=str(path.map_id),
    )
