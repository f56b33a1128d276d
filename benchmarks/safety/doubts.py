"""Motion consistency of the follower: false stops a kilometre, and how soon each wrong pose is noticed.

A simulated car follows winding roads by a localiser that knows the truth up to noise. What is nominal: the car slips,
its wheelbase, lags and straight-ahead position are not those of the parameters, a tenth of the poses is lost, 10 or 5
a second, with wheel odometry or without. Limits were chosen on seeds 0 to 9; the figures are those of seeds 10 to 29.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from tqdm import tqdm

from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState, WheelErrors, WheelOdometry
from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams, SafetyParams
from path_follower.path import Pose2, compose_poses
from path_follower.path_files import make_path
from path_follower.reasons import StopReason
from sphere_nav.geometry.arrays import Array

HELP = "motion consistency: false stops a kilometre, delay and way of each wrong pose"
LENGTH_M = 150.0  # of each nominal drive
SECOND, STEP_NS, LATENCY_NS, ODOMETRY_NS = 1_000_000_000, 10_000_000, 50_000_000, 20_000_000
NOISE = (0.02, 0.02, math.radians(0.5))  # m, m, rad: standard deviations of the poses, stated truthfully
TRUTH = np.diag(np.square(NOISE))
SLIP, WHEELBASE_ERROR, LAG_ERROR, LOST, BIAS = 0.02, 0.03, 0.5, 0.1, math.radians(0.5)
KILOMETER = 1000.0
FALSE_STOPS = 0.1  # a kilometre
DOUBTS = (
    StopReason.POSE_UNCERTAIN, StopReason.POSE_JUMP, StopReason.POSE_FROZEN, StopReason.POSE_INCONSISTENT,
    StopReason.NOT_MOVING, StopReason.ODOM_TIMEOUT,
)  # fmt: skip
Seen = tuple[Pose2, Array]  # a pose and its covariance


@dataclass
class Fault:
    """What happens to the poses, `age` s after it began, or to the car; `reason`: of the stop, empty: drives on."""

    name: str
    reason: str
    seen: Callable[[Drive, Seen, float], Seen] = lambda drive, seen, age: seen
    is_blocked: bool = False
    odometry: str = ""  # silent; stands: says so, again and again
    has_odometry: tuple[bool, ...] = (False, True)


@dataclass
class Drive:
    """A drive on a winding road; `fault` begins when `begin` says."""

    seed: int
    has_odometry: bool = False
    period_ns: int = 100_000_000
    length: float = 500.0
    fault: Fault | None = None
    now: int = SECOND
    way: float = 0.0
    stops: list[str] = field(default_factory=list)
    num_slow: int = 0
    shares: list[float] = field(default_factory=list)  # of what stops, with each pose
    began: int = -1

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, self.period_ns, self.has_odometry])
        sign = self.rng.choice([-1.0, 1.0], 3)
        self.bias, self.lost = BIAS * sign[2], LOST
        lag = 0.2 * (1.0 + LAG_ERROR * sign[1])
        wheelbase = 1.2 * (1.0 + WHEELBASE_ERROR * sign[0])
        actuators = ActuatorParams(steering_lag=lag, speed_lag=lag)
        self.vehicle = Vehicle(VehicleState(), CarParams(wheelbase=wheelbase), actuators)
        # at 5 Hz two lost poses in a row are longer than the usual limit
        safety = SafetyParams(max_pose_silence=max(0.4, 4.5e-9 * self.period_ns))
        params = FollowerParams(safety=safety)
        self.follower = Follower(params, make_path(road(self.rng, self.length), None, None, params))
        self.wheels = WheelOdometry(ODOMETRY_NS / SECOND, self.seed, WheelErrors(slip=SLIP))
        self.command, self.heard = VehicleCommand(), 0
        self.pending: list[tuple[int, Seen]] = []
        self.kept: list[Seen] = []
        self.told: Pose2 | None = None  # where the wheels stand
        self.last_state = FollowerState.IDLE

    def run(self, seconds: float, *, is_restarted: bool = True) -> None:
        """Let time pass; on after a stop."""
        end = self.now + round(seconds * SECOND)
        while self.now < end and self.follower.mode.state is not FollowerState.FINISHED:
            self._sense()
            self._tick()
            self._move()
            if is_restarted and self.follower.mode.state in (FollowerState.IDLE, FollowerState.STOPPED):
                self.follower.start(self.now)
            self.now += STEP_NS

    @property
    def age(self) -> float:
        """Seconds since the fault began."""
        return (self.now - self.began) / SECOND if self.began >= 0 else -1.0

    def _sense(self) -> None:
        fault = self.fault if self.began >= 0 else None
        if self.has_odometry and self.now % ODOMETRY_NS == 0 and not (fault and fault.odometry == "silent"):
            motion = (self.wheels.speed, self.wheels.yaw_rate)
            if fault and fault.odometry == "stands":
                self.told, motion = self.told or Pose2(*self.wheels.pose), (0.0, 0.0)
            told = self.told or Pose2(*self.wheels.pose)
            self.follower.consistency.see_odometry(told, *motion, self.now)
        if self.now % self.period_ns == 0 and self.rng.random() >= self.lost:
            state, noise = self.vehicle.state, Pose2(*self.rng.normal(size=3) * NOISE)
            seen = compose_poses(Pose2(state.x, state.y, state.yaw), noise), TRUTH
            self.pending.append((self.now, fault.seen(self, seen, self.age) if fault else seen))

    def _tick(self) -> None:
        follower = self.follower
        if self.pending and self.pending[0][0] + LATENCY_NS <= self.now:
            stamp, (pose, covariance) = self.pending.pop(0)
            follower.watch.see_status("TRACKING", self.now)
            follower.see_pose(pose, stamp, None, covariance)
            self.shares.append(follower.watch.doubt.share)
            self.heard = self.now
        elif self.now - self.heard <= 0.12 * SECOND or self.now % 25_000_000:
            return
        command = follower.tick(self.now)
        angle = command.steering_angle + self.bias
        rate = command.speed * math.tan(angle) / self.vehicle.params.wheelbase
        self.command = VehicleCommand((1.0 - SLIP) * command.speed, (1.0 - SLIP) * rate)
        state = follower.mode.state
        if state is FollowerState.STOPPING and self.last_state is not state:
            self.stops.append(str(follower.mode.verdict.reason))
        self.num_slow += state is FollowerState.SLOW and self.last_state is FollowerState.DRIVING
        self.last_state = state

    def _move(self) -> None:
        seconds = STEP_NS / SECOND
        if self.began >= 0 and self.fault is not None and self.fault.is_blocked:
            self.vehicle.state = replace(self.vehicle.state, speed=0.0)
        else:
            self.vehicle.step(self.command, seconds)
        self.wheels.step(self.vehicle.state.speed, self.vehicle.yaw_rate, seconds)
        self.way += abs(self.vehicle.state.speed) * seconds


def road(rng: np.random.Generator, length: float) -> Array:
    """Return points (N, 2) every 0.25 m of straights and bends down to 5 m radius."""
    bends: list[float] = [0.0] * 40
    while len(bends) < 4 * length:
        bend = float(rng.choice([0.0, 1.0])) * rng.uniform(-0.2, 0.2)
        bends += [bend] * int(rng.integers(12, 60))
    yaw = np.cumsum(np.array(bends) * 0.25)
    return np.cumsum(0.25 * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1), axis=0)


# --- faults
def _frozen(drive: Drive, seen: Seen, age: float) -> Seen:
    drive.kept = drive.kept or [seen]
    return drive.kept[0]


def _beside(x: float, y: float, yaw: float) -> Callable[[Drive, Seen, float], Seen]:
    """Return poses that are `x`, `y` m and `yaw` rad beside the right ones, from one image to the next."""
    return lambda drive, seen, age: (Pose2(seen[0].x + x, seen[0].y + y, seen[0].yaw + yaw), seen[1])


def _jump(drive: Drive, seen: Seen, age: float) -> Seen:
    angle = 0.7 * drive.seed
    return compose_poses(seen[0], Pose2(0.9 * math.cos(angle), 0.9 * math.sin(angle), 0.0)), seen[1]


def _heading(drive: Drive, seen: Seen, age: float) -> Seen:
    return compose_poses(seen[0], Pose2(0.0, 0.0, 0.9 * (-1) ** drive.seed)), seen[1]


def _heading_slowly(drive: Drive, seen: Seen, age: float) -> Seen:
    """Turn to 0.6 rad within 20 s: no single pose shows it."""
    return compose_poses(seen[0], Pose2(0.0, 0.0, min(0.03 * age, 0.6) * (-1) ** drive.seed)), seen[1]


def _yaw_drift(rate: float) -> Callable[[Drive, Seen, float], Seen]:
    return lambda drive, seen, age: (compose_poses(seen[0], Pose2(0.0, 0.0, rate * age * (-1) ** drive.seed)), seen[1])


def _drift(along: float, aside: float) -> Callable[[Drive, Seen, float], Seen]:
    """Return poses that go wrong by so many m/s."""
    return lambda drive, seen, age: (
        compose_poses(seen[0], Pose2(along * age, aside * age * (-1) ** drive.seed, 0.0)),
        seen[1],
    )


def _covariance(value: Array) -> Callable[[Drive, Seen, float], Seen]:
    return lambda drive, seen, age: (seen[0], value)


def _correction(deviation: float) -> Callable[[Drive, Seen, float], Seen]:
    """Return poses corrected by 0.15 m and 2 degrees, with this standard deviation in the second before."""

    def correct(drive: Drive, seen: Seen, age: float) -> Seen:
        pose = compose_poses(seen[0], Pose2(0.1, 0.11, 0.035)) if age >= 1.0 else seen[0]
        return pose, np.diag(np.square([deviation, deviation, max(deviation / 5.0, NOISE[2])]))

    return correct


NOT_SEMIDEFINITE = np.array([[1e-4, 1e-2, 0.0], [1e-2, 1e-4, 0.0], [0.0, 0.0, 1e-4]])
FAULTS = (
    Fault("pose frozen, new stamps", "POSE_FROZEN", _frozen),
    Fault("vehicle blocked", "NOT_MOVING", is_blocked=True),
    Fault("vehicle blocked, pose the same number", "NOT_MOVING", _frozen, is_blocked=True, has_odometry=(True,)),
    Fault("pose jumps by 0.9 m", "POSE_JUMP", _jump),
    Fault("heading 0.9 rad wrong at once", "POSE_JUMP", _heading),
    Fault("heading turns wrong by 0.03 rad/s, to 0.6 rad", "POSE_INCONSISTENT", _heading_slowly),
    Fault("heading drifts by 0.2 rad/s", "POSE_INCONSISTENT", _yaw_drift(0.2)),
    Fault("pose drifts sideways by 0.5 m/s", "POSE_INCONSISTENT", _drift(0.0, 0.5)),
    Fault("pose drifts sideways by 0.1 m/s", "POSE_INCONSISTENT", _drift(0.0, 0.1), has_odometry=(True,)),
    Fault("pose lags by 0.2 m/s", "POSE_INCONSISTENT", _drift(-0.2, 0.0), has_odometry=(True,)),
    Fault("covariance of 1e6", "POSE_UNCERTAIN", _covariance(1e6 * np.eye(3))),
    Fault("covariance not positive semidefinite", "POSE_UNCERTAIN", _covariance(NOT_SEMIDEFINITE)),
    Fault("covariance of zeros", "POSE_UNCERTAIN", _covariance(np.zeros((3, 3)))),
    Fault("standard deviation of 0.7 m", "", _covariance(np.diag([0.49, 0.49, 1e-4]))),
    Fault("pose corrected by 0.15 m, stated 0.1 m", "", _correction(0.1)),
    Fault("pose corrected by 0.15 m, stated 0.02 m", "", _correction(0.02)),
    Fault("wheels stand", "POSE_INCONSISTENT", odometry="stands", has_odometry=(True,)),
    Fault("wheels silent", "ODOM_TIMEOUT", odometry="silent", has_odometry=(True,)),
)


@dataclass
class Outcome:
    """Drives of one fault."""

    fault: Fault
    has_odometry: bool
    seconds: list[float] = field(default_factory=list)
    meters: list[float] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    def suffer(self, seed: int, window: float) -> None:
        """Drive off, let it happen, and see what the follower does in `window` s."""
        drive = Drive(seed, self.has_odometry, length=100.0, fault=self.fault)
        drive.run(8.0 + 0.37 * (seed % 10))
        drive.lost = 0.0  # a pose lost in time must not end it by another reason
        drive.began, way, num_stops = drive.now, drive.way, len(drive.stops)
        while drive.age < window and len(drive.stops) == num_stops:
            drive.run(0.01, is_restarted=False)
        found = drive.stops[num_stops:]
        self.reasons.append(found[0] if found else "")
        if found:
            self.seconds.append(drive.age)
            self.meters.append(drive.way - way)

    @property
    def num_wrong(self) -> int:
        """Number of drives that did not end as they should."""
        return sum(reason != self.fault.reason for reason in self.reasons)

    @property
    def row(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        counts = {reason: self.reasons.count(reason) for reason in sorted(set(self.reasons))}
        words = ", ".join(f"{reason or 'drives on'} {count}" for reason, count in counts.items())
        cells = [
            f"{np.median(values):.2f} ({max(values):.2f})" if values else "–" for values in (self.seconds, self.meters)
        ]
        return (self.fault.name, "yes" if self.has_odometry else "no", words, *cells)


def run(options: argparse.Namespace) -> Report:
    """Drive without a fault in each setting, then suffer every fault."""
    seeds = range(options.seed, options.seed + (1 if options.size == "quick" else 20))
    rows, bounds = [], []
    way, num_stops = 0.0, 0
    settings = [(period, has_odometry) for period in (100, 200) for has_odometry in (False, True)]
    for period, has_odometry in settings:
        drives = [Drive(seed, has_odometry, period * 1_000_000, LENGTH_M) for seed in seeds]
        for drive in tqdm(drives, unit="drive", disable=None):
            drive.run(2.0 * LENGTH_M)
        meters = sum(drive.way for drive in drives)
        doubts = [reason for drive in drives for reason in drive.stops if reason in DOUBTS]
        others = sum(len(drive.stops) for drive in drives) - len(doubts)
        slow = sum(drive.num_slow for drive in drives)
        way, num_stops = way + meters, num_stops + len(doubts)
        words = ", ".join(sorted(set(doubts))) or "–"
        shares = np.concatenate([drive.shares for drive in drives])
        tail = f"{np.quantile(shares, 0.999):.2f}, {shares.max():.2f}"
        cells = (f"{meters / KILOMETER:.2f}", str(len(doubts)), words, tail, str(slow), str(others))
        rows.append((f"{1000 // period} Hz, odometry: {'yes' if has_odometry else 'no'}", *cells))
    what = f"false stops a kilometre in {way / KILOMETER:.2f} km, with the doubts on"
    of = Headline("robustness", f"{len(seeds)} drives in each of {len(settings)} settings")
    bounds.append(Bound(what, FALSE_STOPS, num_stops / way * KILOMETER, "1/km", headline=of))
    outcomes = [Outcome(fault, has) for fault in FAULTS for has in fault.has_odometry]
    for outcome in tqdm(outcomes, unit="fault", disable=None):
        for seed in seeds[:10]:
            outcome.suffer(seed, 25.0 if outcome.fault.reason else 6.0)
    stopped = [outcome for outcome in outcomes if outcome.fault.reason]
    bounds.append(Bound("drives that ended otherwise than they should", 0, sum(o.num_wrong for o in outcomes), ""))
    worst = max((m for o in stopped for m in o.meters), default=math.nan)
    bounds.append(Bound("way from a fault to the stop's begin, largest", 15.0, worst, "m"))
    columns = ("drives", "km", "false stops", "reasons", "share of what stops 99.9 %, max", "times slow", "other stops")
    faults = ("fault", "odometry", "ends", "noticed after: median (max) [s]", "way [m]")
    tables = [Table("Nominal", columns, rows), Table("Faults", faults, [o.row for o in outcomes])]
    return Report("doubts", tables, bounds)
