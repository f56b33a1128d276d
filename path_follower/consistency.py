"""Does the pose move as the vehicle does? Innovation tests between poses and dead reckoning.

The motion of the poses between two images, p = x_i^-1 x_n = (x, y, yaw) seen from the earlier pose, is compared with
the motion d of the wheels' odometry or, without it, of the commands through the bicycle model with its lags. Where
nothing is wrong, the innovation e = p - d is normal with

    S = J_i C_i J_i' + J_n C_n J_n' + Q,

C the covariances of the two poses and Q that of the dead reckoning, so that e' S^-1 e is chi^2 of 3 degrees of freedom.
It is tested from image to image and over `WINDOWS` metres; a test above the quantile of `STOP_ALARM` stops, one above
that of `SLOW_ALARM` slows down. Both are false-alarm rates of one test where the noise is as stated; the windows
overlap and the pose's errors are partly common to both ends, so that the rate of a drive is smaller:
docs/notes/motion_consistency.md.

Odometry is believed where it agrees with the pose, or is nearer to the commands than the pose is: two of three
outvote the third.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammainccinv

from path_follower.constants import (
    COMMAND_ERRORS,
    EVIDENCE_NS,
    MAX_GAP_NS,
    MAX_ODOMETRY_GAP_NS,
    MEMORY_NS,
    ODOMETRY_ERRORS,
    POSE_FLOOR,
    RELEVANT,
    SLOW_ALARM,
    STILL,
    STILL_WAY,
    STOP_ALARM,
    WINDOWS,
    MotionErrors,
)
from path_follower.params import FollowerParams, SafetyParams
from path_follower.path import Pose2, between, compose_poses, wrap
from path_follower.reasons import FINE, StopReason, StopVerdict
from path_follower.vehicle import ORIGIN, Motion, Predictor
from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.geometry.arrays import Array

STOP_GATE, SLOW_GATE = (2.0 * float(gammainccinv(1.5, rate)) for rate in (STOP_ALARM, SLOW_ALARM))  # chi^2, 3 dof
FLOOR = np.diag(np.square(POSE_FLOOR))


@dataclass(frozen=True)
class Doubt:
    """What speaks against a pose: a reason to stop, and one to drive slowly; FINE where there is none."""

    stop: StopVerdict = FINE
    slow: StopVerdict = FINE
    squared: float = 0.0  # the largest innovation of its tests, chi^2 of 3 degrees of freedom where nothing is wrong


@dataclass(frozen=True)
class Reckoning:
    """Dead reckoning up to an instant: pose from where it began, and sums of what its errors grow with."""

    pose: Pose2 = ORIGIN
    way: float = 0.0  # m
    turned: float = 0.0  # rad
    speed_change: float = 0.0  # m/s, of its magnitude
    bend_change: float = 0.0  # 1/m times m/s: change of the yaw rate by steering, rad/s
    speed: float = 0.0  # m/s, at the end

    def moved(self, step: Pose2, before: Motion, after: Motion, wheelbase: float) -> Reckoning:
        """Return it with another step, `before` and `after` which the vehicle moved as stated."""
        bend = abs(math.tan(after.steering_angle) - math.tan(before.steering_angle)) / wheelbase
        return Reckoning(
            compose_poses(self.pose, step),
            self.way + math.hypot(step.x, step.y),
            self.turned + abs(step.yaw),
            self.speed_change + abs(after.speed - before.speed),
            self.bend_change + bend * abs(after.speed),
            after.speed,
        )

    def since(self, then: Reckoning) -> tuple[Pose2, Reckoning]:
        """Return the motion since then, seen from there, and what its errors grow with."""
        motion = between(then.pose, self.pose)
        growth = Reckoning(
            motion,
            self.way - then.way,
            self.turned - then.turned,
            self.speed_change - then.speed_change,
            self.bend_change - then.bend_change,
            max(abs(self.speed), abs(then.speed)),
        )
        return motion, growth


@dataclass(frozen=True)
class DrivenPose:
    """A pose, its covariance (3, 3) of (x, y, yaw) in its own axes, and where dead reckoning was at its stamp."""

    time_ns: int
    pose: Pose2
    covariance: Array
    commanded: Reckoning
    odometry: Reckoning | None


class MotionConsistency:
    """Give it every pose, and odometry where there is one; what it returns holds until the next pose."""

    def __init__(self, params: FollowerParams, predictor: Predictor) -> None:
        self.params = params
        self._predictor = predictor
        share = params.actuation.uncertainty
        self._errors = MotionErrors(share, *COMMAND_ERRORS[1:3], share, COMMAND_ERRORS.timing)
        self.reset()

    def reset(self) -> None:
        """Forget everything with a stamp."""
        self._samples: deque[DrivenPose] = deque()
        self._driven: Reckoning | None = None  # by odometry, up to the last pose at which it was known
        self._odometry: deque[tuple[int, Pose2, float, float]] = deque()  # time, pose, m/s, rad/s
        self._evidence_ns = self._slow_since_ns = -1
        self._evidence = FINE
        self._largest = 0.0

    def see_odometry(self, pose: Pose2, speed: float, yaw_rate: float, time_ns: int) -> None:
        """Accept the wheels' odometry: pose in a frame of its own, and what the wheels do now."""
        if self._odometry and time_ns <= self._odometry[-1][0]:
            return
        self._odometry.append((time_ns, pose, speed, yaw_rate))
        while time_ns - self._odometry[0][0] > MAX_GAP_NS:
            self._odometry.popleft()

    def see_pose(self, pose: Pose2, covariance: Array | None, time_ns: int, *, is_driving: bool) -> Doubt:
        """Return what speaks against a pose; `covariance` (3, 3) of (x, y, yaw) in the vehicle's axes.

        `is_driving`: the vehicle moves by our commands. A pose that jumps while it stands is none of our business.
        """
        doubt = judge_covariance(covariance, self.params.safety)
        if doubt.stop is not FINE or not self.params.safety.is_motion_checked:
            self._samples.clear()
            return doubt
        last = self._samples[-1] if self._samples else None
        if last is not None and not 0 < time_ns - last.time_ns <= MAX_GAP_NS:
            self._samples.clear()
            last = self._driven = None
        matrix = FLOOR
        if covariance is not None:
            matrix = covariance + np.diag(np.maximum(np.diagonal(FLOOR) - np.diagonal(covariance), 0.0))
        sample = DrivenPose(time_ns, pose, matrix, self._commanded(last, time_ns), self._wheels(time_ns))
        if not is_driving:
            self._samples.clear()
            self._evidence_ns = self._slow_since_ns = -1
        self._largest = 0.0
        stop = self._test(sample) if is_driving else FINE
        self._samples.append(sample)
        self._forget(sample)
        if stop is not FINE:
            return Doubt(stop, stop, self._largest)
        return replace(self._slow(doubt.slow, time_ns), squared=self._largest)

    def _forget(self, now: DrivenPose) -> None:
        """Drop what no test goes back to."""
        while (
            now.commanded.way - self._samples[0].commanded.way > 2.0 * WINDOWS[-1]
            or now.time_ns - self._samples[0].time_ns > MEMORY_NS
        ):
            self._samples.popleft()

    def _slow(self, uncertain: StopVerdict, now_ns: int) -> Doubt:
        """Drive slowly while there is mild evidence, and `EVIDENCE_NS` longer; for a limited time."""
        is_recent = self._evidence_ns >= 0 and now_ns - self._evidence_ns <= EVIDENCE_NS
        slow = self._evidence if is_recent else uncertain
        if slow is FINE:
            self._slow_since_ns = -1
            return Doubt()
        self._slow_since_ns = self._slow_since_ns if self._slow_since_ns >= 0 else now_ns
        seconds, limit = (now_ns - self._slow_since_ns) / 1e9, self.params.safety.max_degraded_time
        if seconds > limit:
            found = f"for {seconds:.3g} s, limit {limit:.3g}: {slow.detail}"
            return Doubt(StopVerdict(slow.reason, seconds, limit, found), slow)
        return Doubt(FINE, slow)

    # --- dead reckoning
    def _commanded(self, last: DrivenPose | None, time_ns: int) -> Reckoning:
        if last is None:
            return Reckoning(speed=self._predictor.travel(time_ns, time_ns)[1].speed)
        step, before, after = self._predictor.travel(last.time_ns, time_ns)
        return last.commanded.moved(step, before, after, self.params.vehicle.virtual_wheelbase)

    def _wheels(self, time_ns: int) -> Reckoning | None:
        """Return the odometry at a time; what it has driven since the last pose adds to its errors."""
        found = self._odometry_at(time_ns)
        if found is None:
            return None
        pose, speed = found
        if self._driven is None:
            self._driven = Reckoning(pose, speed=speed)
        else:
            step, before = between(self._driven.pose, pose), Motion(self._driven.speed, 0.0)
            self._driven = self._driven.moved(step, before, Motion(speed, 0.0), 1.0)
        return self._driven

    def _odometry_at(self, time_ns: int) -> tuple[Pose2, float] | None:
        """Return pose and speed between two messages, or a little after the last; None where they are not known."""
        after = None
        for before in reversed(self._odometry):
            if before[0] <= time_ns:
                break
            after = before
        else:
            return None
        then, pose, speed, yaw_rate = before
        seconds = (time_ns - then) / 1e9
        if after is None:
            if time_ns - then > MAX_ODOMETRY_GAP_NS:
                return None
            return compose_poses(pose, _arc(speed * seconds, yaw_rate * seconds)), speed
        if after[0] - then > 2 * MAX_ODOMETRY_GAP_NS:
            return None
        step, share = between(pose, after[1]), (time_ns - then) / (after[0] - then)
        part = Pose2(share * step.x, share * step.y, share * step.yaw)
        return compose_poses(pose, part), speed + share * (after[2] - speed)

    # --- tests
    def _test(self, now: DrivenPose) -> StopVerdict:
        """Compare with the last pose, and with those some metres before."""
        if not self._samples:
            return FINE
        tested = {id(self._samples[-1]): (self._samples[-1], True)}
        for window in WINDOWS:
            if (then := self._before(now, window)) is not None:
                tested.setdefault(id(then), (then, False))
        for then, is_last in tested.values():
            verdict = self._compare(then, now, is_last=is_last)
            if verdict is not FINE:
                return verdict
        return FINE

    def _before(self, now: DrivenPose, way: float) -> DrivenPose | None:
        """Return the last pose from which at least `way` m were commanded up to now."""
        return next((s for s in reversed(self._samples) if now.commanded.way - s.commanded.way >= way), None)

    def _compare(self, then: DrivenPose, now: DrivenPose, *, is_last: bool) -> StopVerdict:
        """Test one pair of poses: by odometry where it agrees with pose or commands, else by commands."""
        pose = between(then.pose, now.pose)
        noise = pose_noise(pose, then.covariance, now.covariance)
        commanded, growth = now.commanded.since(then.commanded)
        Q = process_noise(commanded, growth, self._errors)
        by_commands = _Innovation(pose, commanded, noise + Q)
        wheels: _Innovation | None = None
        found = by_commands
        if then.odometry is not None and now.odometry is not None:
            driven, sums = now.odometry.since(then.odometry)
            Q_wheels = process_noise(driven, sums, ODOMETRY_ERRORS)
            wheels = _Innovation(pose, driven, noise + Q_wheels)
            stood = by_commands.is_strong and _is_still(driven, commanded) and _is_still(pose, commanded)
            if stood:
                return _not_moving(StopReason.NOT_MOVING, commanded, by_commands)
            between_both = _Innovation(
                driven, commanded, FLOOR + Q + Q_wheels
            )  # who is nearer to the commands is believed
            if not wheels.is_strong or between_both.squared <= by_commands.squared:
                found = wheels
        self._largest = max(self._largest, found.squared)
        if found.is_mild:
            self._evidence_ns, self._evidence = now.time_ns, _verdict(StopReason.POSE_INCONSISTENT, found)
        if not found.is_strong:
            return FINE
        since = self._before(now, STILL_WAY) or then  # a window begins before the pose froze
        is_repeated = self._samples[-1].pose == now.pose
        if is_repeated or _is_still(between(since.pose, now.pose), between(since.commanded.pose, now.commanded.pose)):
            is_frozen = found is wheels or is_repeated
            return _not_moving(StopReason.POSE_FROZEN if is_frozen else StopReason.NOT_MOVING, commanded, found)
        return _verdict(StopReason.POSE_JUMP if is_last else StopReason.POSE_INCONSISTENT, found)


class _Innovation:
    """The difference of two motions, in standard deviations."""

    def __init__(self, measured: Pose2, expected: Pose2, covariance: Array) -> None:
        self.expected = expected
        yaw = wrap(measured.yaw - expected.yaw)
        self.way, self.yaw = math.hypot(measured.x - expected.x, measured.y - expected.y), abs(yaw)
        error = np.array([measured.x - expected.x, measured.y - expected.y, yaw])
        self.squared = squared_mahalanobis(error, covariance)

    @property
    def is_strong(self) -> bool:
        """Whether it is beyond chance, and large enough to matter to a drive."""
        return self.squared > STOP_GATE and (self.way > RELEVANT[0] or self.yaw > RELEVANT[1])

    @property
    def is_mild(self) -> bool:
        return self.squared > SLOW_GATE


def judge_covariance(covariance: Array | None, limits: SafetyParams) -> Doubt:
    """Return whether a pose with this covariance (3, 3) may be driven by; zero or none: not stated.

    The standard deviation of the position is that of its worst direction. Above a limit: slowly; above twice: not.
    """
    if covariance is None:
        return Doubt()
    if not np.isfinite(covariance).all():
        return Doubt(StopVerdict(StopReason.POSE_UNCERTAIN, detail="covariance: expected finite numbers"))
    values = np.linalg.eigvalsh(covariance)
    if values[0] < -1e-6 * max(values[-1], 1e-6):
        found = f"covariance: expected positive semidefinite, found the eigenvalue {values[0]:.3g}"
        return Doubt(StopVerdict(StopReason.POSE_UNCERTAIN, detail=found))
    position = math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    yaw = math.sqrt(max(float(covariance[2, 2]), 0.0))
    checks = ((position, limits.max_deviation, "m"), (yaw, limits.max_yaw_deviation, "rad"))
    value, limit, unit = max(checks, key=lambda check: check[0] / check[1])
    if value <= limit:
        return Doubt()
    found = f"standard deviation {value:.3g} {unit}, limit {limit:.3g}"
    slow = StopVerdict(StopReason.POSE_UNCERTAIN, value, limit, found, "driving slowly until the pose is certain again")
    if value <= 2.0 * limit:
        return Doubt(FINE, slow)
    found = f"standard deviation {value:.3g} {unit}, limit {2.0 * limit:.3g}"
    return Doubt(StopVerdict(StopReason.POSE_UNCERTAIN, value, 2.0 * limit, found), slow)


def pose_noise(motion: Pose2, then: Array, now: Array) -> Array:
    """Return the covariance (3, 3) of the motion between two poses, from theirs, each in its own axes.

    An error of the earlier heading turns the motion: d(x, y) = (y, -x) d yaw.
    """
    J_then = np.array([[-1.0, 0.0, motion.y], [0.0, -1.0, -motion.x], [0.0, 0.0, -1.0]])
    cosine, sine = math.cos(motion.yaw), math.sin(motion.yaw)
    J_now = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    covariance: Array = J_then @ then @ J_then.T + J_now @ now @ J_now.T
    return covariance


def process_noise(motion: Pose2, growth: Reckoning, errors: MotionErrors) -> Array:
    """Return the covariance (3, 3) of a motion by dead reckoning, seen from where it began.

    An error of the turn, thought to grow evenly with the way, displaces the end by half of it times the motion.
    """
    yaw = (errors.yaw_per_meter * growth.way) ** 2 + (errors.turn * growth.turned) ** 2
    yaw += (errors.timing * growth.bend_change) ** 2
    along = (errors.along * growth.way) ** 2 + (errors.timing * growth.speed_change) ** 2
    along += (errors.stamp * growth.speed) ** 2
    across = (errors.across * growth.way) ** 2
    yaw += (errors.stamp * growth.speed * growth.turned / max(growth.way, 0.1)) ** 2
    c, s = math.cos(motion.yaw / 2.0), math.sin(motion.yaw / 2.0)  # of the direction of the way
    x, y = -motion.y / 2.0, motion.x / 2.0  # what an error of the turn moves the end by
    xx = along * c * c + across * s * s + yaw * x * x
    xy = (along - across) * c * s + yaw * x * y
    yy = along * s * s + across * c * c + yaw * y * y
    return np.array([[xx, xy, yaw * x], [xy, yy, yaw * y], [yaw * x, yaw * y, yaw]])


def _arc(way: float, turn: float) -> Pose2:
    return Pose2(way * math.cos(turn / 2.0), way * math.sin(turn / 2.0), turn)


def _is_still(motion: Pose2, expected: Pose2) -> bool:
    """Whether a motion is next to nothing where one was expected."""
    return math.hypot(motion.x, motion.y) < STILL * math.hypot(expected.x, expected.y) and abs(motion.yaw) < RELEVANT[1]


def _verdict(reason: StopReason, found: _Innovation) -> StopVerdict:
    text = f"{found.way:.2f} m and {found.yaw:.2f} rad beside the vehicle's own motion"
    detail = f"{text} of {math.hypot(found.expected.x, found.expected.y):.2f} m, chi^2 {found.squared:.0f}"
    advice = "" if found.is_strong else "driving slowly until pose and motion agree again"
    return StopVerdict(reason, found.squared, STOP_GATE, detail, advice)


def _not_moving(reason: StopReason, expected: Pose2, found: _Innovation) -> StopVerdict:
    way = math.hypot(expected.x, expected.y)
    source = "the vehicle went" if reason is StopReason.POSE_FROZEN else "the commands were to go"
    return StopVerdict(reason, found.squared, STOP_GATE, f"{source} {way:.2f} m, the pose stands")
