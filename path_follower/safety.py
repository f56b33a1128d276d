"""When to stop: what is known about localisation, pose, scan and emergency stop, and since when.

All times are ns of one clock that no stamp can move (`Times` in `sphere_nav/ros/clocks.py`): a message counts from its
arrival, or from its stamp where that is older.
"""

from __future__ import annotations

import math

import numpy as np

from path_follower.consistency import Doubt, MotionConsistency
from path_follower.constants import MAX_DEGRADED_TIME, MAX_OFF_HEADING, SEARCH_WINDOW, SENSOR_SILENCE
from path_follower.obstacles import points_in_way, stopping_distance
from path_follower.params import FollowerParams
from path_follower.path import Location, Pose2, ReferencePath
from path_follower.reasons import FINE, StopReason, blocked, first_of, over
from path_follower.vehicle import Predictor
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import TRUSTED, Reason, State, Verdict


class SafetyMonitor:
    """What was received last, and when. Judges whether the vehicle may move."""

    def __init__(self, params: FollowerParams, predictor: Predictor) -> None:
        """Begin with nothing received."""
        self.params = params
        self.consistency = MotionConsistency(params, predictor)
        self.is_emergency = False
        self.outside = FINE  # what others do that the vehicle must not drive with
        self.reset()

    def reset(self) -> None:
        """Forget all inputs but the emergency stop, as after a jump of the clock."""
        self.T_map_base: SE3 | None = None
        self.speed: float | None = None  # m/s, as measured with the pose
        self.pose_ns = self.status_ns = self.scan_ns = self.degraded_ns = self.blind_ns = -1
        self.state = self.state_reason = self.refusal = self.scan_refusal = self.map_id = ""
        self.is_pose_bad = False
        self.doubt = Doubt()  # of the last pose, against odometry and commands
        self.points = np.empty((0, 2))
        self.consistency.reset()

    @property
    def pose(self) -> Pose2 | None:
        """The pose on the ground."""
        return None if self.T_map_base is None else Pose2.of(self.T_map_base)

    def see_pose(
        self,
        T_map_base: SE3,
        time_ns: int,
        speed: float | None = None,
        covariance: Array | None = None,
        *,
        is_driving: bool = False,
    ) -> None:
        """Accept a pose; one that is not newer than the last, or not a number, is not kept.

        `covariance` (3, 3) of (x, y, yaw) in the vehicle's axes, None: not stated. `is_driving`: by our commands.
        """
        self.is_pose_bad = not np.isfinite(T_map_base.matrix).all()
        if self.is_pose_bad or time_ns <= self.pose_ns:
            return
        self.T_map_base, self.pose_ns, self.speed, self.refusal = T_map_base, time_ns, speed, ""
        self.doubt = self.consistency.see_pose(Pose2.of(T_map_base), covariance, time_ns, is_driving=is_driving)

    def refuse_pose(self, why: str, *, is_bad: bool) -> None:
        """Note a pose that cannot be used; one that is `is_bad` stops at once, else the silence that follows does."""
        self.refusal = why
        self.is_pose_bad = self.is_pose_bad or is_bad

    def see_status(self, state: str, now_ns: int, reason: str = "", age: float = 0.0, map_id: str = "") -> None:
        """Accept the state of the localiser, unless it is good news older than the last.

        `age` s: since an image confirmed the pose, where a reason speaks of it. A state that is no more DEGRADED ends
        the count of its time, an image that confirms the pose that of blindness. `map_id`: empty where unknown.
        """
        if state in TRUSTED and now_ns < self.status_ns:
            return
        if state != State.DEGRADED:
            self.degraded_ns = -1
        elif self.degraded_ns < 0:
            self.degraded_ns = now_ns
        if not reason or age <= 0.0:
            self.blind_ns = -1
        elif self.blind_ns < 0:
            self.blind_ns = max(now_ns - round(min(age, 1e6) * 1e9), self.status_ns)
        self.state, self.state_reason, self.status_ns, self.map_id = state, reason, now_ns, map_id

    def see_scan(self, points: Array, now_ns: int) -> None:
        """Accept the finite points (N, 2) of a scan in the vehicle's frame, x forward from the rear axle, in m."""
        self.points, self.scan_ns, self.scan_refusal = points[np.isfinite(points).all(axis=-1)], now_ns, ""

    def refuse_scan(self, why: str) -> None:
        """Note a scan that cannot be used: the silence that follows stops, at once where there never was a usable one.

        A scanner that is there but cannot be used is no reason to drive as if there were none, required or not.
        """
        self.scan_refusal = why

    @property
    def is_slow(self) -> bool:
        """Whether the localisation allows slow motion only."""
        is_degraded = self.params.safety.is_status_required and self.state == State.DEGRADED
        return is_degraded or self.doubt.slow is not FINE

    def judge_inputs(self, now_ns: int) -> Verdict:
        """Return why the inputs do not allow motion, or FINE."""
        if self.is_emergency:
            return Verdict(StopReason.EMERGENCY_STOP)
        if self.outside is not FINE:
            return self.outside
        if self.is_pose_bad:
            return Verdict(StopReason.BAD_POSE, detail=self.refusal)
        limits, scan = self.params.safety, FINE
        pose = _silence(StopReason.POSE_TIMEOUT, self.pose_ns, now_ns, limits.max_pose_silence, "pose", self.refusal)
        if self.scan_ns >= 0 or limits.is_scan_required or self.scan_refusal:
            refused = self.scan_refusal
            scan = _silence(StopReason.SCAN_TIMEOUT, self.scan_ns, now_ns, SENSOR_SILENCE, "scan", refused)
        return first_of(pose, self.doubt.stop, self._judge_status(now_ns), scan)

    def judge_map(self, path: ReferencePath) -> Verdict:
        """Return whether the path is one of the localiser's map, as far as both say of which they are."""
        if not path.map_id or not self.map_id or path.map_id == self.map_id:
            return FINE
        return Verdict(StopReason.WRONG_MAP, detail=f"the path is of map {path.map_id}, the pose of {self.map_id}")

    def judge_place(self, location: Location) -> Verdict:
        """Return whether the vehicle has left the path."""
        return first_of(
            over(StopReason.OFF_PATH, location.distance, self.params.safety.max_distance),
            over(StopReason.OFF_PATH, abs(location.heading_error), MAX_OFF_HEADING),
        )

    def judge_path(self, path: ReferencePath, location: Location, speed: float) -> Verdict:
        """Return the first reason against motion from a place on a path at a speed: its map, the place, the way."""
        place = first_of(self.judge_map(path), self.judge_place(location))
        pose = self.pose
        if place is not FINE or not len(self.points) or pose is None:
            return place
        distance = stopping_distance(speed, self.params)  # in the footprint swept until the vehicle could stop
        return blocked(points_in_way(self.points, pose, path, location, distance, self.params))

    def find_start(self, path: ReferencePath, last: Location | None) -> tuple[Verdict, Location | None]:
        """Return where on the path the vehicle stands: near the last place if there is one, else anywhere."""
        pose = self.pose
        assert pose is not None
        here = path.advance(pose, last, SEARCH_WINDOW) if last is not None else None
        if here is None or self.judge_place(here) is not FINE:
            here = path.locate(pose)
        if here is None:
            return first_of(self.judge_map(path), Verdict(StopReason.OFF_PATH, math.pi, MAX_OFF_HEADING)), None
        return self.judge_path(path, here, 0.0), here

    def _judge_status(self, now_ns: int) -> Verdict:
        limits, lost = self.params.safety, StopReason.NOT_LOCALISED
        if not limits.is_status_required:
            return FINE
        silent = _silence(StopReason.STATUS_TIMEOUT, self.status_ns, now_ns, limits.max_status_silence, "status")
        if silent is not FINE:
            return silent
        if self.state not in TRUSTED:
            found = f"{self.state} {self.state_reason}".strip()
            return Verdict(lost, detail=f"the localiser is {found}" if found else "")
        if self.state_reason == Reason.FROZEN:  # the camera shows the past: no prediction carries over that
            return Verdict(lost, detail="the camera repeats an image")
        blind, degraded = _since(self.blind_ns, now_ns), _since(self.degraded_ns, now_ns)
        found = f"no image confirms the pose for {blind:.3g} s, limit {limits.max_blind_time:.3g}"
        return first_of(
            over(lost, blind, limits.max_blind_time, found),
            over(StopReason.LOCALISATION_DEGRADED, degraded, MAX_DEGRADED_TIME),
        )


def _silence(reason: StopReason, heard_ns: int, now_ns: int, limit: float, what: str, refused: str = "") -> Verdict:
    """Return whether something has not come yet, or not for longer than a limit in s."""
    told = f" (refused: {refused})" if refused else ""
    if heard_ns < 0:
        return Verdict(reason, 0.0, limit, f"no {what} yet{told}")
    age = (now_ns - heard_ns) / 1e9
    return over(reason, age, limit, f"found {age:.3g} s, limit {limit:.3g}{told}")


def _since(begin_ns: int, now_ns: int) -> float:
    return (now_ns - begin_ns) / 1e9 if begin_ns >= 0 else 0.0
