"""When to stop and why; what is known about localisation, pose, scan and emergency stop."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from path_follower.params import FollowerParams
from path_follower.path import Location, Pose2, ReferencePath

Array = NDArray[np.float64]

TRUSTED, DEGRADED = "TRACKING", "DEGRADED"  # states of the localisers in which motion is allowed
SWEEP_STEP = 0.2  # m between the footprints that are checked


class Reason(enum.StrEnum):
    """Why the vehicle does not drive; the words of FollowerStatus."""

    NONE = ""
    OPERATOR = "OPERATOR"
    NOT_LOCALISED = "NOT_LOCALISED"
    LOCALISATION_DEGRADED = "LOCALISATION_DEGRADED"
    POSE_TIMEOUT = "POSE_TIMEOUT"
    STATUS_TIMEOUT = "STATUS_TIMEOUT"
    BAD_POSE = "BAD_POSE"
    OFF_PATH = "OFF_PATH"
    OBSTACLE = "OBSTACLE"
    SCAN_TIMEOUT = "SCAN_TIMEOUT"
    EMERGENCY_STOP = "EMERGENCY_STOP"
    END_OF_PATH = "END_OF_PATH"


REMEDIES = {
    Reason.NONE: "",
    Reason.OPERATOR: "call start",
    Reason.NOT_LOCALISED: "wait for TRACKING or call relocalize of the localiser, then call start",
    Reason.LOCALISATION_DEGRADED: "wait for TRACKING, then call start",
    Reason.POSE_TIMEOUT: "check the localiser, the topic of the pose and the clocks, then call start",
    Reason.STATUS_TIMEOUT: "check the localiser and the topic of its status, then call start",
    Reason.BAD_POSE: "check the frame and the values of the pose, then call start",
    Reason.OFF_PATH: "bring the vehicle onto the path, heading along it, then call start",
    Reason.OBSTACLE: "clear the way, then call start",
    Reason.SCAN_TIMEOUT: "check the scanner and its topic, then call start",
    Reason.EMERGENCY_STOP: "release the emergency stop, then call start",
    Reason.END_OF_PATH: "load a path or bring the vehicle to its beginning, then call start",
}


@dataclass(frozen=True)
class Verdict:
    """A reason, what was measured for it and the limit it broke, in the same unit."""

    reason: Reason
    value: float = 0.0
    limit: float = 0.0

    def __str__(self) -> str:
        """Everything in one line; empty if all is fine."""
        if self.reason is Reason.NONE:
            return ""
        found = f": found {self.value:.3g}, limit {self.limit:.3g}" if self.limit else ""
        return f"{self.reason}{found}: {self.remedy}"

    @property
    def remedy(self) -> str:
        """One line that says what to do."""
        return REMEDIES[self.reason]

    @property
    def is_gentle(self) -> bool:
        """Whether the ordinary deceleration is enough."""
        return self.reason in (Reason.NONE, Reason.OPERATOR, Reason.END_OF_PATH)


FINE = Verdict(Reason.NONE)


class Watch:
    """What was heard last, and when. Judges whether the vehicle may move."""

    def __init__(self, params: FollowerParams) -> None:
        """Begin with nothing heard."""
        self.params = params
        self.reset()

    def reset(self) -> None:
        """Forget all inputs but the emergency stop, as after a jump of the clock."""
        self.pose: Pose2 | None = None
        self.pose_ns = self.status_ns = self.scan_ns = self.degraded_ns = -1
        self.state = ""
        self.is_pose_bad = False
        self.points = np.empty((0, 2))
        self.is_emergency = getattr(self, "is_emergency", False)

    def see_pose(self, pose: Pose2, stamp_ns: int) -> bool:
        """Take a pose; return False for one that is not newer than the last, or not a number."""
        self.is_pose_bad = not all(map(math.isfinite, pose))
        if self.is_pose_bad or stamp_ns <= self.pose_ns:
            return False
        self.pose, self.pose_ns = pose, stamp_ns
        return True

    def see_status(self, state: str, now_ns: int) -> None:
        """Take the state of the localiser; a state that is no more DEGRADED ends the count of its time."""
        if state != DEGRADED:
            self.degraded_ns = -1
        elif self.degraded_ns < 0:
            self.degraded_ns = now_ns
        self.state, self.status_ns = state, now_ns

    def see_scan(self, points: Array, now_ns: int) -> None:
        """Take the finite points (N, 2) of a scan in the vehicle's frame, x forward from the rear axle, in m."""
        self.points, self.scan_ns = points[np.isfinite(points).all(axis=-1)], now_ns

    @property
    def is_slow(self) -> bool:
        """Whether the localisation allows slow motion only."""
        return self.params.safety.is_status_required and self.state == DEGRADED

    def judge_inputs(self, now_ns: int) -> Verdict:
        """Return why the inputs do not allow motion, or FINE."""
        limits = self.params.safety
        pose_age = (now_ns - self.pose_ns) / 1e9
        if self.is_emergency:
            return Verdict(Reason.EMERGENCY_STOP, 1.0, 0.0)
        if self.is_pose_bad:
            return Verdict(Reason.BAD_POSE)
        if self.pose_ns < 0 or pose_age > limits.max_pose_silence:
            return Verdict(Reason.POSE_TIMEOUT, pose_age if self.pose_ns >= 0 else 0.0, limits.max_pose_silence)
        status = self._judge_status(now_ns) if limits.is_status_required else FINE
        return status if status is not FINE else self._judge_scan(now_ns)

    def judge_place(self, location: Location) -> Verdict:
        """Return whether the vehicle has left the path."""
        limits = self.params.safety
        if location.distance > limits.max_distance:
            return Verdict(Reason.OFF_PATH, location.distance, limits.max_distance)
        if abs(location.heading_error) > limits.max_heading_error:
            return Verdict(Reason.OFF_PATH, abs(location.heading_error), limits.max_heading_error)
        return FINE

    def judge_way(self, path: ReferencePath, location: Location, speed: float) -> Verdict:
        """Return whether something stands in the way: in the footprint swept until the vehicle could stop."""
        if not len(self.points) or self.pose is None:
            return FINE
        distance = stopping_distance(speed, self.params)
        count = points_in_way(self.points, self.pose, path, location, distance, self.params)
        needed = self.params.safety.obstacle_points
        return Verdict(Reason.OBSTACLE, float(count), float(needed)) if count >= needed else FINE

    def find_start(self, path: ReferencePath, last: Location | None) -> tuple[Verdict, Location | None]:
        """Return where on the path the vehicle stands: near the last place if there is one, else anywhere."""
        assert self.pose is not None
        limits = self.params.safety
        if last is not None:
            near = path.advance(self.pose, last, self.params.path.search_window)
            if near.distance <= limits.max_start_distance and self.judge_place(near) is FINE:
                return self.judge_way(path, near, 0.0), near
        here = path.locate(self.pose, limits.max_heading_error)
        if here is None:
            return Verdict(Reason.OFF_PATH, math.pi, limits.max_heading_error), None
        if here.distance > limits.max_start_distance:
            return Verdict(Reason.OFF_PATH, here.distance, limits.max_start_distance), None
        return self.judge_way(path, here, 0.0), here

    def _judge_status(self, now_ns: int) -> Verdict:
        limits = self.params.safety
        age = (now_ns - self.status_ns) / 1e9
        if self.status_ns < 0 or age > limits.max_status_silence:
            return Verdict(Reason.STATUS_TIMEOUT, age if self.status_ns >= 0 else 0.0, limits.max_status_silence)
        if self.state not in (TRUSTED, DEGRADED):
            return Verdict(Reason.NOT_LOCALISED)
        degraded = (now_ns - self.degraded_ns) / 1e9 if self.degraded_ns >= 0 else 0.0
        if degraded > limits.max_degraded_time:
            return Verdict(Reason.LOCALISATION_DEGRADED, degraded, limits.max_degraded_time)
        return FINE

    def _judge_scan(self, now_ns: int) -> Verdict:
        limits = self.params.safety
        if self.scan_ns < 0 and not limits.is_scan_required:
            return FINE
        age = (now_ns - self.scan_ns) / 1e9 if self.scan_ns >= 0 else 0.0
        if self.scan_ns < 0 or age > limits.max_scan_silence:
            return Verdict(Reason.SCAN_TIMEOUT, age, limits.max_scan_silence)
        return FINE


def stopping_distance(speed: float, params: FollowerParams) -> float:
    """Return the way in m until the vehicle stands at ordinary deceleration, reaction and one step included."""
    v = abs(speed)
    return v * params.safety.obstacle_reaction + v * v / (2.0 * params.vehicle.max_deceleration) + SWEEP_STEP


def points_in_way(
    points: Array, pose: Pose2, path: ReferencePath, location: Location, distance: float, params: FollowerParams
) -> int:
    """Count points (N, 2) of the vehicle's frame in the footprints along the next `distance` m of the path.

    The footprints keep the present offset from the path. Points on the body itself are its own.
    """
    body, margin = params.vehicle, params.safety.obstacle_margin
    half = body.width / 2.0
    own = (points[:, 0] > -body.rear) & (points[:, 0] < body.front) & (np.abs(points[:, 1]) < half)
    others = points[~own]
    here = path.at(location.arc_length, location.segment)
    hit = np.zeros(len(others), dtype=bool)
    for ahead in np.arange(SWEEP_STEP, distance + SWEEP_STEP, SWEEP_STEP):
        there = path.at(min(location.arc_length + ahead, path.end_of(location.segment)), location.segment)
        x, y, turn = _seen_from(here.x, here.y, here.yaw, there.x, there.y, there.yaw)
        heading = here.yaw - pose.yaw  # the path's direction in the vehicle's frame
        cosine, sine = math.cos(heading), math.sin(heading)
        origin = np.array([cosine * x - sine * y, sine * x + cosine * y])
        yaw = heading + turn
        along = (others - origin) @ [math.cos(yaw), math.sin(yaw)]
        across = (others - origin) @ [-math.sin(yaw), math.cos(yaw)]
        hit |= (along > -body.rear - margin) & (along < body.front + margin) & (np.abs(across) < half + margin)
    return int(hit.sum())


def _seen_from(x0: float, y0: float, yaw0: float, x: float, y: float, yaw: float) -> tuple[float, float, float]:
    cosine, sine = math.cos(yaw0), math.sin(yaw0)
    dx, dy = x - x0, y - y0
    return cosine * dx + sine * dy, -sine * dx + cosine * dy, yaw - yaw0
