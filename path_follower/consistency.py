"""Does the pose move as the vehicle does? A sequential test of the poses against dead reckoning.

From one pose to the next, the motion p of the poses, seen from the earlier one (along, across, yaw), is compared with
the motion d of the wheels or, where there are none, of the commands through the bicycle model with its lags. What their
difference exceeds an allowance a, which grows with the way, adds up (CUSUM, Page 1954), each sign of each component by
itself:

    g <- max(0, g + p - d - a)    and    g' <- max(0, g' + d - p - a)

The noise of a pose enters with one sign and leaves with the other at the next one, so that g is how far the pose has
gone wrong since g was 0, and its standard deviation s is that of these two poses. Poses that follow each other share
errors of the map, of which their covariances tell, too: s is no more than what the last steps scatter by admits. Beyond
max(`RELEVANT`, `STOP_SIGMAS` s) g stops, beyond max(`RELEVANT` / 2, `SLOW_SIGMAS` s) the vehicle drives slowly
(docs/notes/motion_consistency.md).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from path_follower.constants import (
    COMMAND_ERRORS,
    LEAST_SCATTER,
    MAX_DEGRADED_TIME,
    MAX_GAP_NS,
    MAX_YAW_DEVIATION,
    NOISE_STEPS,
    RELEVANT,
    SENSOR_SILENCE,
    SLOW_SIGMAS,
    STILL,
    STILL_WAY,
    STOP_SIGMAS,
    WHEEL_ERRORS,
    MotionErrors,
)
from path_follower.params import FollowerParams, SafetyParams
from path_follower.path import Pose2, between, wrap
from path_follower.reasons import FINE, StopReason, first_of, over
from path_follower.vehicle import ORIGIN, Predictor
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.odometry import PoseBuffer
from sphere_nav.geometry.se3 import SE3
from sphere_nav.localization.status import Verdict

NO_VARIANCE = np.zeros(3)


@dataclass(frozen=True)
class Doubt:
    """What speaks against a pose: a reason to stop, and one to drive slowly; FINE where there is none."""

    stop: Verdict = FINE
    slow: Verdict = FINE


class Reckoning(NamedTuple):
    """What dead reckoning says of an instant: a pose in a frame of its own, m/s and rad/s."""

    pose: Pose2
    speed: float
    yaw_rate: float


class Comparison:
    """How far a motion has gone another way than the expected one, beyond what is allowed."""

    def __init__(self) -> None:
        self.reset(NO_VARIANCE)

    def reset(self, variance: Array) -> None:
        """Begin anew, at a pose with the variances (3,) of x, y and yaw."""
        self._sums = np.zeros((2, 3))
        self._begun = np.tile(variance, (2, 1))  # variances of the pose where a sum was last 0
        self._lately: deque[tuple[Pose2, Pose2]] = deque()  # the last steps, measured and expected
        self._scatter = deque[Array](maxlen=NOISE_STEPS)  # squared differences (3,) of the last steps
        self.share = self.slow_share = 0.0  # the largest sum, of what stops and of what slows down
        self.is_leap = False  # whether the last step went further than expected, by more than what stops

    def add(self, measured: Pose2, then: Reckoning, now: Reckoning, errors: MotionErrors, variance: Array) -> None:
        """Compare another step with dead reckoning between two instants; `variance` (3,) is that at its end."""
        expected = between(then.pose, now.pose)
        self._lately.append((measured, expected))
        while math.hypot(*self._way(1, 1)) >= STILL_WAY:
            self._lately.popleft()
        error = np.array([measured.x - expected.x, measured.y - expected.y, wrap(measured.yaw - expected.yaw)])
        allowed = allowance(
            expected, then, now, errors._replace(across=max(errors.across, 2.0 * math.sqrt(variance[2])))
        )
        self._scatter.append(error**2)
        deviation = np.sqrt(self._begun + variance)
        if len(self._scatter) == NOISE_STEPS:
            deviation = np.minimum(deviation, np.sqrt(np.mean(self._scatter, axis=0)) / LEAST_SCATTER)
        self._sums = np.maximum(0.0, self._sums + np.stack([error, -error]) - allowed)
        self._begun = np.where(self._sums > 0.0, self._begun, variance)
        stop = np.maximum(RELEVANT, STOP_SIGMAS * deviation)
        slow = np.maximum(np.multiply(0.5, RELEVANT), SLOW_SIGMAS * deviation)
        self.share, self.slow_share = float(np.max(self._sums / stop)), float(np.max(self._sums / slow))
        further = math.hypot(measured.x, measured.y) - math.hypot(expected.x, expected.y)
        self.is_leap = bool(further > stop[0, 0] or abs(measured.yaw) - abs(expected.yaw) > stop[0, 2])

    def _way(self, which: int, first: int = 0) -> tuple[float, float]:
        steps = [pair[which] for pair in self._lately][first:]
        return sum(step.x for step in steps), sum(step.y for step in steps)

    @property
    def is_still(self) -> bool:
        """Whether what is measured is next to nothing, over the last way that was expected."""
        return math.hypot(*self._way(0)) < STILL * math.hypot(*self._way(1))

    @property
    def is_repeated(self) -> bool:
        """Whether the last step is none to the last digit."""
        return bool(self._lately) and self._lately[-1][0] == ORIGIN

    @property
    def found(self) -> str:
        """What has added up, in words."""
        x, y, yaw = self._sums.max(axis=0)
        return f"{math.hypot(x, y):.2f} m and {yaw:.2f} rad"


class Instant(NamedTuple):
    """A pose, and what the wheels said of its stamp, as far as known."""

    time_ns: int
    pose: Pose2
    wheels: Reckoning | None


class MotionConsistency:
    """Give it every pose, and odometry where there is one; what it returns holds until the next pose."""

    def __init__(self, params: FollowerParams, predictor: Predictor) -> None:
        self.params = params
        self._predictor = predictor
        self._pose, self._wheels = Comparison(), Comparison()  # with wheels or commands; with commands
        self.reset()

    def reset(self) -> None:
        """Forget everything with a stamp."""
        self._odometry = PoseBuffer[Array]()  # with twists (6,)
        self._begin(None, NO_VARIANCE)

    def _begin(self, last: Instant | None, variance: Array) -> None:
        self._last, self._uncertain_ns = last, -1
        self._pose.reset(variance)
        self._wheels.reset(NO_VARIANCE)

    def see_odometry(self, pose: Pose2, speed: float, yaw_rate: float, time_ns: int) -> None:
        """Accept the wheels' odometry: pose in a frame of its own, and what the wheels do now."""
        if self._odometry and time_ns <= self._odometry[-1][0]:
            return
        twist = np.array([speed, 0.0, 0.0, 0.0, 0.0, yaw_rate])
        self._odometry.append((time_ns, SE3.from_planar(*pose), twist))
        while time_ns - self._odometry[0][0] > MAX_GAP_NS:
            self._odometry.popleft()

    def see_pose(self, pose: Pose2, covariance: Array | None, time_ns: int, *, is_driving: bool) -> Doubt:
        """Return what speaks against a pose; `covariance` (3, 3) of (x, y, yaw) in the vehicle's axes.

        `is_driving`: the vehicle moves by our commands. A pose that jumps while it stands is none of our business.
        """
        doubt = judge_covariance(covariance, self.params.safety)
        silence = (time_ns - self._odometry[-1][0]) / 1e9 if self._odometry else 0.0
        stop = first_of(doubt.stop, over(StopReason.ODOM_TIMEOUT, silence, SENSOR_SILENCE))
        if stop is not FINE or not self.params.safety.is_motion_checked:
            self._begin(None, NO_VARIANCE)
            return replace(doubt, stop=stop)
        variance = NO_VARIANCE if covariance is None else np.diagonal(covariance)
        last, now = self._last, Instant(time_ns, pose, self.wheels_at(time_ns))
        if last is None or not is_driving or not 0 < time_ns - last.time_ns <= MAX_GAP_NS:
            self._begin(now, variance)
            return doubt
        self._compare(last, now, variance)
        self._last = now
        stop = self._judge_motion()
        return Doubt(stop, stop) if stop is not FINE else self._slow(doubt.slow, time_ns)

    def _compare(self, last: Instant, now: Instant, variance: Array) -> None:
        """Compare the pose with the wheels and these with the commands; with the commands where no wheels are heard."""
        way, *motions = self._predictor.travel(last.time_ns, now.time_ns)
        rates = [(motion.speed, motion.yaw_rate(self.params.vehicle.virtual_wheelbase)) for motion in motions]
        commanded = Reckoning(ORIGIN, *rates[0]), Reckoning(way, *rates[1])
        moved = between(last.pose, now.pose)
        if not self._odometry:
            self._pose.add(moved, *commanded, COMMAND_ERRORS, variance)
        elif last.wheels is not None and now.wheels is not None:
            self._pose.add(moved, last.wheels, now.wheels, WHEEL_ERRORS, variance)
            self._wheels.add(between(last.wheels.pose, now.wheels.pose), *commanded, COMMAND_ERRORS, NO_VARIANCE)

    def _judge_motion(self) -> Verdict:
        """Name what is wrong; a blocked vehicle looks like a frozen pose where no wheels are heard."""
        pose, source = self._pose, "wheels" if self._odometry else "commands"
        if pose.share > 1.0:
            is_frozen = pose.is_repeated or (bool(self._odometry) and pose.is_still)
            reason = StopReason.POSE_JUMP if pose.is_leap else StopReason.POSE_INCONSISTENT
            reason = StopReason.NOT_MOVING if pose.is_still else reason
            reason = StopReason.POSE_FROZEN if is_frozen else reason
            return Verdict(reason, pose.share, 1.0, f"the pose is {pose.found} beside the motion of the {source}")
        if self._wheels.share > 1.0 and self._wheels.is_still and pose.slow_share <= 1.0:
            found = f"wheels and pose are {self._wheels.found} beside the motion of the commands"
            return Verdict(StopReason.NOT_MOVING, self._wheels.share, 1.0, found)
        return FINE

    def _slow(self, uncertain: Verdict, now_ns: int) -> Doubt:
        """Drive slowly while the pose is uncertain, for a limited time, or beside the motion by less than stops."""
        if uncertain is FINE:
            self._uncertain_ns = -1
            if self._pose.slow_share <= 1.0:
                return Doubt()
            advice = "driving slowly until pose and motion agree again"
            return Doubt(FINE, Verdict(StopReason.POSE_INCONSISTENT, self._pose.share, 1.0, self._pose.found, advice))
        self._uncertain_ns = self._uncertain_ns if self._uncertain_ns >= 0 else now_ns
        seconds, limit = (now_ns - self._uncertain_ns) / 1e9, MAX_DEGRADED_TIME
        found = f"for {seconds:.3g} s, limit {limit:.3g}: {uncertain.detail}"
        return Doubt(over(StopReason.POSE_UNCERTAIN, seconds, limit, found), uncertain)

    # --- wheels
    def wheels_at(self, time_ns: int) -> Reckoning | None:
        """Return the odometry at a time, between two messages or after the last; None before the first."""
        if not self._odometry or time_ns < self._odometry[0][0]:
            return None
        last_ns, last, twist = self._odometry[-1]
        found = self._odometry.at(time_ns) or (last @ SE3.exp(twist * (time_ns - last_ns) / 1e9), twist)
        return Reckoning(Pose2.of(found[0]), float(found[1][0]), float(found[1][5]))


def allowance(step: Pose2, then: Reckoning, now: Reckoning, errors: MotionErrors) -> Array:
    """Return by how much (along, across, yaw) of a motion by dead reckoning may be wrong."""
    way = math.hypot(step.x, step.y)
    along = errors.along * way + errors.timing * abs(now.speed - then.speed)
    yaw = errors.yaw_per_meter * way + errors.turn * abs(step.yaw) + errors.timing * abs(now.yaw_rate - then.yaw_rate)
    return np.array([along, errors.across * way, yaw])


def judge_covariance(covariance: Array | None, limits: SafetyParams) -> Doubt:
    """Return whether a pose with this covariance (3, 3) may be driven by; None: the caller does not ask.

    The standard deviation of the position is that of its worst direction. Above a limit: slowly; above twice: not.
    """
    if covariance is None:
        return Doubt()
    found = ""
    if not np.isfinite(covariance).all():
        found = "finite numbers"
    elif not np.diagonal(covariance).all():
        found = "that of x, y and yaw, found zeros: none is stated"
    elif (values := np.linalg.eigvalsh(covariance))[0] < -1e-6 * max(values[-1], 1e-6):
        found = f"positive semidefinite, found the eigenvalue {values[0]:.3g}"
    if found:
        return Doubt(Verdict(StopReason.POSE_UNCERTAIN, detail=f"covariance: expected {found}"))
    position = math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    yaw = math.sqrt(max(float(covariance[2, 2]), 0.0))
    checks = ((position, limits.max_deviation, "m"), (yaw, MAX_YAW_DEVIATION, "rad"))
    value, limit, unit = max(checks, key=lambda check: check[0] / check[1])
    found = f"standard deviation {value:.3g} {unit}, limit "
    advice = "driving slowly until the pose is certain again"
    slow = over(StopReason.POSE_UNCERTAIN, value, limit, f"{found}{limit:.3g}", advice)
    return Doubt(over(StopReason.POSE_UNCERTAIN, value, 2.0 * limit, f"{found}{2.0 * limit:.3g}"), slow)
