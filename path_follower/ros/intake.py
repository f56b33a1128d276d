"""What the vehicle is driven by: poses and the localiser's status, or directions and what their source says."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus

from path_follower.constants import BEAM_FORGETTING, MIN_MEASURED, PAIRED
from path_follower.follower import Follower
from path_follower.homing import HomingFollower
from path_follower.modes import FollowerState
from path_follower.obstacles import swept_places
from path_follower.params import PathFollowerParams
from path_follower.path import Pose2
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import PLANAR, Array
from sphere_nav.localization.status import TRUSTED, State, Status
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.clocks import time_of
from sphere_nav.ros.constants import MAX_AHEAD_NS
from sphere_nav.ros.conversions import driving
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.tf import TransformError

FOOTPRINTS = ("", "base_footprint")  # frames of wheels that lie above or below the base's own
Answer = Callable[[int], None]  # publish the command that answers a message of this stamp


class Answered:
    """The newest stamp that was answered: a status without a pose is answered itself, where none is to come."""

    def __init__(self, endpoints: Endpoints, answer: Answer, catch_up: Answer, *, is_patient: bool = False) -> None:
        """`catch_up(now_ns)`: do what is due before a message of that time.

        `is_patient`: of pose and status of one image the second one is answered, so that both are always known.
        """
        self.endpoints, self._answer, self._catch_up, self._is_patient = endpoints, answer, catch_up, is_patient
        self.forget()

    def forget(self) -> None:
        """Forget all stamps."""
        self.stamp_ns = self._pose_ns = self._status_ns = 0

    def accept(self, stamp_ns: int) -> None:
        """Be told of a message before the follower is."""
        self._catch_up(self._bounded(stamp_ns))

    def answer(self, stamp_ns: int) -> None:
        """Answer a message."""
        self.stamp_ns = max(self.stamp_ns, stamp_ns)
        self._answer(stamp_ns)

    def answer_pose(self, stamp_ns: int, *, is_refused: bool = False) -> None:
        """Answer a pose, now or with its status; one that was refused is no news, unless its status waits for it."""
        self._pose_ns = max(self._pose_ns, self._bounded(stamp_ns))
        if self._status_ns >= stamp_ns if self._is_patient else not is_refused:
            self.answer(stamp_ns)

    def answer_status(self, stamp_ns: int, *, is_good: bool, has_pose: bool = False) -> None:
        """Answer a message after which no pose is to come, if it is the first of its stamp, whatever that is."""
        stamp_ns = self._bounded(stamp_ns)
        self._status_ns = max(self._status_ns, stamp_ns)
        is_due = self._pose_ns >= stamp_ns or not has_pose if self._is_patient else not is_good
        if stamp_ns > self.stamp_ns and is_due:
            self.answer(stamp_ns)

    def _bounded(self, stamp_ns: int) -> int:
        """Return a stamp, or the present for one that /clock cannot just be late for: what follows it is no news."""
        lead_ns = stamp_ns - self.endpoints.now_ns()
        return stamp_ns - lead_ns if lead_ns > MAX_AHEAD_NS else stamp_ns


class PoseIntake:
    """Poses of base_link in the map, or an odometry there, and the state of the localiser.

    Bad news counts at once; good news counts where it belongs to a pose, which has its stamp: what somebody else says
    of other images does not hide that the pose is lost.
    """

    def __init__(
        self, endpoints: Endpoints, params: PathFollowerParams, follower: Follower, answered: Answered
    ) -> None:
        self._watch, self._follower, self._answered, self._params = follower.watch, follower, answered, params
        if params.source == "pose":
            self.topic = endpoints.add_subscription("pose", PoseWithCovarianceStamped, self.on_pose, qos.STATE).topic
        else:
            self.topic = endpoints.add_subscription("odometry", Odometry, self.on_odometry, qos.STATE).topic
        self._poses: deque[int] = deque(maxlen=PAIRED)  # stamps
        self._good_news: deque[tuple[int, int, Status]] = deque(maxlen=PAIRED)  # stamp, from when it counts, and what
        needed = params.safety.is_status_required
        endpoints.add_subscription("status", LocalizationStatus, self.on_status, qos.STATE, is_required=needed)
        if params.safety.is_motion_checked:
            endpoints.add_subscription("odom", Odometry, self.on_wheels, qos.SENSOR, is_required=False)

    def on_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Answer a pose."""
        self._accept(message, lambda: conversions.pose_with_covariance_to_se3(message, self._params.map_frame))

    def on_odometry(self, message: Odometry) -> None:
        """Answer an odometry: pose and speed."""

        def convert() -> tuple[SE3, Array]:
            driving.check_frames(message, self._params.map_frame, self._params.base_frame)
            T_map_base = conversions.odometry_to_se3(message)[0]
            return T_map_base, conversions.from_ros_covariance(message.pose.covariance, T_map_base)

        self._accept(message, convert, float(message.twist.twist.linear.x))

    def on_wheels(self, message: Odometry) -> None:
        """Hand on what the wheels have driven, in a frame of their own; ValueError for what cannot be used."""
        if message.child_frame_id not in (self._params.base_frame, *FOOTPRINTS):
            expected, found = self._params.base_frame, message.child_frame_id
            raise ValueError(f"odom: child_frame_id: expected {expected!r}, found {found!r}")
        T_odom_base, twist = conversions.odometry_to_se3(message)
        time = time_of(conversions.stamp_ns(message), self._answered.endpoints)
        self._watch.consistency.see_odometry(Pose2.of(T_odom_base), float(twist[0]), float(twist[5]), time)

    def _accept(self, message: Any, convert: Callable[[], tuple[SE3, Array]], speed: float | None = None) -> None:
        """Hand a pose on and answer it; ValueError for one that cannot be used, which stops the vehicle."""
        stamp, is_bad = -1, False
        try:
            stamp, is_bad = conversions.stamp_ns(message), True
            T_map_base, covariance = convert()
            is_bad = False
            time = time_of(stamp, self._answered.endpoints)
        except ValueError as error:
            self._watch.refuse_pose(str(error), is_bad=is_bad)
            if stamp >= 0:
                self._answered.answer_pose(stamp, is_refused=True)
            raise
        self._answered.accept(stamp)
        self._follower.see_pose(T_map_base, time, speed, covariance[PLANAR])
        self._poses.append(stamp)
        self._see_paired()
        self._answered.answer_pose(stamp)

    def on_status(self, message: LocalizationStatus) -> None:
        """Hand on the state of the localiser; bad news counts at once, good news by its stamp, and with its pose."""
        stamp, endpoints = stamp_of_news(message), self._answered.endpoints
        status = conversions.message_to_status(message)
        is_good = status.state in TRUSTED
        time = time_of(stamp, endpoints) if is_good else endpoints.own_ns()
        self._answered.accept(stamp)
        is_worse = not is_good or (status.state == State.DEGRADED and self._watch.state == State.TRACKING)
        if is_worse:
            self._watch.see_status(status.state, time, status.reason, status.age, status.map_id)
        else:
            self._good_news.append((stamp, time, status))
            self._see_paired()
        # what was computed of an image that is trusted has a pose; it may come after its status
        self._answered.answer_status(stamp, is_good=is_good, has_pose=is_good and status.milliseconds > 0.0)
        if len(self._good_news) == PAIRED:
            raise ValueError(f"header.stamp: expected that of a pose, found another one {PAIRED} times")

    def _see_paired(self) -> None:
        """Hand on the good news whose pose is known."""
        for item in [item for item in self._good_news if item[0] in self._poses]:
            _, time, status = item
            self._good_news.remove(item)
            self._watch.see_status(status.state, time, status.reason, status.age, status.map_id)


def stamp_of_news(message: Any) -> int:
    """Return the stamp of a status; one that cannot be is set to 0, for bad news counts whatever its stamp."""
    try:
        return conversions.stamp_ns(message)
    except ValueError:
        message.header.stamp = Time()
        return 0


class DirectionIntake:
    """Directions of mcl_depth, seen from base_link, and whether they may be followed."""

    def __init__(
        self, endpoints: Endpoints, params: PathFollowerParams, follower: HomingFollower, answered: Answered
    ) -> None:
        self._follower, self._answered, self._frame = follower, answered, params.base_frame
        self.topic = endpoints.add_subscription("homing/direction", PoseStamped, self.on_direction, qos.STATE).topic
        endpoints.add_subscription("homing/status", FollowerStatus, self.on_source, qos.STATE)

    def on_direction(self, message: PoseStamped) -> None:
        """Answer a direction: x of the pose."""
        stamp = conversions.stamp_ns(message)
        driving.check_frames(message, self._frame)
        yaw = float(conversions.pose_to_se3(message.pose).yaw)
        time = time_of(stamp, self._answered.endpoints)
        self._answered.accept(stamp)
        self._follower.see(yaw, time)
        self._answered.answer(stamp)

    def on_source(self, message: FollowerStatus) -> None:
        """Hand on whether the directions may be followed."""
        stamp, endpoints = stamp_of_news(message), self._answered.endpoints
        state, way = driving.message_to_progress(message)
        is_trusted, is_there = state == FollowerState.DRIVING, state == FollowerState.FINISHED
        time = time_of(stamp, endpoints) if is_trusted or is_there else endpoints.own_ns()
        self._answered.accept(stamp)
        self._follower.see_source(is_trusted=is_trusted, is_there=is_there, way=way, now_ns=time)
        self._answered.answer_status(stamp, is_good=is_trusted)


class ScanIntake:
    """Obstacles, seen from base_link. A scan that cannot be used, or sees nothing where it should, counts as none."""

    def __init__(self, endpoints: Endpoints, params: PathFollowerParams, follower: Follower) -> None:
        self._follower, self._endpoints, self._base = follower, endpoints, params.base_frame
        self.frame, self._placed, self._T_base_scan = "", "", SE3.identity()  # of the scanner; the one that is placed
        self._usual = 0.0  # share of the beams that lately measured
        is_required = params.safety.is_scan_required
        endpoints.add_subscription("scan", LaserScan, self.on_scan, qos.SENSOR, is_required=is_required)

    def place(self, frame: str, T_base_scan: SE3) -> None:
        """Take where the scanner of a frame is mounted."""
        self._placed, self._T_base_scan = frame, T_base_scan

    def on_scan(self, message: LaserScan) -> None:
        """Hand on the points of a scan; ValueError for one that cannot be used, whose silence stops the vehicle."""
        self.frame = message.header.frame_id
        try:
            time = time_of(conversions.stamp_ns(message), self._endpoints)
            points = driving.scan_to_points(message)
            if self.frame != self._placed:
                raise TransformError(f"tf: expected a transform {self.frame} -> {self._base}, found none yet")
            self._check_sight(message)
        except ValueError as error:
            self._follower.watch.refuse_scan(str(error))
            raise
        self._follower.watch.see_scan(self._T_base_scan.apply(points)[:, :2], time)

    def _check_sight(self, message: LaserScan) -> None:
        """Raise ValueError where too few beams measured, of all and of those towards the way of the vehicle."""
        measured = driving.measured_beams(message)
        share = float(measured.mean())
        usual, self._usual = self._usual, max(share, BEAM_FORGETTING * self._usual)
        if share < MIN_MEASURED * usual:
            expected = f"about {usual:.0%} of the beams to measure, as lately"
            raise ValueError(f"scan: ranges: expected {expected}, found {share:.0%} (NaN, 0 or below range_min: none)")
        params = self._follower.params  # as they are now: some are live
        places = swept_places(self._follower.heading, params)
        height = np.full((len(places), 1), self._T_base_scan.translation[2])
        x, y, _ = self._T_base_scan.inverse().apply(np.concatenate([places, height], axis=1)).T
        turn = (np.arctan2(y, x) - message.angle_min) * np.sign(message.angle_increment or 1.0) % (2.0 * np.pi)
        beam = np.rint(turn / max(abs(message.angle_increment), 1e-9))
        seen = measured[beam[beam < len(measured)].astype(int)]
        if seen.size == 0 and params.safety.is_scan_required:
            raise ValueError("scan: expected beams where the vehicle drives (safety.is_scan_required), found none")
        if seen.size and seen.mean() < MIN_MEASURED:
            expected = f"at least {MIN_MEASURED:.0%} of the way ahead measured (+Inf where nothing is in range)"
            raise ValueError(f"scan: ranges: expected {expected}, found {seen.mean():.0%}")
