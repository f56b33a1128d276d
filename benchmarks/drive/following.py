"""The follower on recorded courses, beside pure pursuit, Stanley and regulated pure pursuit.

One car drives for all of them (`cycab_sim/vehicle.py`, lags of 0.2 s), one localiser tells poses of 20 Hz, 0.1 s late,
with noise of 5 mm and 0.1 degrees; path, speeds, limits of the commands and stops are those of the follower. Of every
rival the gain is the best of a grid on the first part of the course; all are judged on the rest. As published they
steer by the pose as it is measured.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState
from path_follower.command import TrackingError
from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams, SpeedParams, VehicleParams
from path_follower.path import Location, Pose2, ReferencePath, wrap
from path_follower.path_files import read_path

HELP = "the follower beside pure pursuit, Stanley and regulated pure pursuit on recorded courses"
COURSES = {
    "Budapest": (8.0, 2.0),  # m/s at most, m/s^2 sideways
    "Hockenheim": (8.0, 2.0),
    "IMS": (8.0, 2.0),
    "comma2k19_motorway_enu_20hz": (35.0, 3.0),
}
PERIOD_S, LATENCY_S = 0.05, 0.1
NOISE_M, NOISE_RAD = 0.005, math.radians(0.1)
TUNED_M, QUICK_M = 400.0, 400.0  # of way on which gains are chosen; that is judged of a quick run
MAX_RMSE_M, MAX_SECONDS = 0.03, 3600.0
SECOND = 10**9


class Record(NamedTuple):
    """What one drive was: way and signed distance of the true car from the path (N,)."""

    way: NDArray[np.float64]
    lateral: NDArray[np.float64]

    def rmse(self, begin: float = 0.0) -> float:
        """Return the root of the mean squared distance behind `begin` metres of way."""
        part = self.lateral[self.way >= begin]
        return float(np.sqrt(np.mean(part**2))) if len(part) else math.nan


class Car(CarParams):
    """The simulated car without limits of speed: those of the commands hold."""

    max_speed: ClassVar[float] = 50.0
    max_acceleration: ClassVar[float] = 10.0
    max_deceleration: ClassVar[float] = 10.0


Steer = Callable[["Rival", Pose2, Location], float]


class Rival(Follower):
    """The follower with another rule for the curvature, by the pose as measured."""

    def __init__(self, params: FollowerParams, path: ReferencePath, steer: Steer, gain: float) -> None:
        super().__init__(params, path)
        self.steer, self.gain = steer, gain

    def _law(self, tracking: TrackingError | None) -> tuple[float, float | None]:
        speed, curvature = super()._law(tracking)
        if curvature is None or self.path is None or self.location is None or self.watch.pose is None:
            return speed, curvature
        return speed, self.steer(self, self.watch.pose, self.location)

    def towards(self, pose: Pose2, here: Location, distance: float) -> float:
        """Return the curvature 1/m of the circle to the point of the path at a distance m ahead."""
        assert self.path is not None
        goal = self.path.at(here.arc_length + distance, here.segment)
        dx, dy = goal.x - pose.x, goal.y - pose.y
        sideways = -math.sin(pose.yaw) * dx + math.cos(pose.yaw) * dy
        return 2.0 * sideways / max(dx * dx + dy * dy, 1e-6)


def pure_pursuit(rival: Rival, pose: Pose2, here: Location) -> float:
    """Steer at a point a fixed distance ahead (Coulter 1992)."""
    return rival.towards(pose, here, rival.gain)


def regulated_pure_pursuit(rival: Rival, pose: Pose2, here: Location) -> float:
    """Steer at a point ahead by a time, at least half a metre (Macenski 2023); its speeds are those of all here."""
    return rival.towards(pose, here, max(0.5, rival.gain * abs(rival.limiter.last.speed)))


def stanley(rival: Rival, pose: Pose2, here: Location) -> float:
    """Steer the front wheel along the path and towards it (Thrun 2006), plus the angle of the bend itself."""
    assert rival.path is not None
    base, speed = rival.params.vehicle.virtual_wheelbase, abs(rival.limiter.last.speed)
    front = Pose2(pose.x + base * math.cos(pose.yaw), pose.y + base * math.sin(pose.yaw), pose.yaw)
    foot = rival.path.advance(front, replace(here, arc_length=here.arc_length + 0.5 * base), base + 2.0)
    bend = rival.path.at(foot.arc_length, foot.segment)
    angle = wrap(bend.yaw - pose.yaw) - math.atan(rival.gain * foot.cross_track / (0.5 + speed))
    return math.tan(min(max(angle, -1.2), 1.2)) / base


RIVALS: dict[str, tuple[Steer, tuple[float, ...]]] = {
    "pure pursuit": (pure_pursuit, (1.0, 2.0, 4.0, 8.0, 16.0)),
    "Stanley": (stanley, (0.5, 1.0, 2.0, 4.0)),
    "regulated pure pursuit": (regulated_pure_pursuit, (0.3, 0.6, 1.0, 1.5)),
}


def drive(follower: Follower, *, seed: int, way: float = math.inf) -> Record:
    """Drive along the path until it ends, or for a way."""
    path, params = follower.path, follower.params
    assert path is not None
    rng = np.random.default_rng(seed)
    p = params.vehicle
    car = Car(
        wheelbase=p.virtual_wheelbase, max_steering_angle=p.max_steering_angle, max_steering_rate=p.max_steering_rate
    )
    start = VehicleState(float(path.x[0]), float(path.y[0]), float(path.yaw[0]))
    vehicle, pending = Vehicle(start, car, ActuatorParams()), deque[tuple[int, Pose2]]()
    ways: list[float] = []
    lateral: list[float] = []
    for step in itertools.count():
        now = SECOND + round(step * PERIOD_S * SECOND)
        pose = Pose2(vehicle.state.x, vehicle.state.y, vehicle.state.yaw)
        noise = rng.normal(size=3) * (NOISE_M, NOISE_M, NOISE_RAD)
        pending.append((now, Pose2(pose.x + noise[0], pose.y + noise[1], pose.yaw + noise[2])))
        is_due = pending[0][0] <= now - round(LATENCY_S * SECOND)
        then, measured = pending.popleft() if is_due else (0, pose)
        command = follower.update(measured, None, then, "TRACKING", now_ns=now) if is_due else follower.tick(now)
        if follower.mode.state is FollowerState.IDLE and follower.watch.pose is not None:
            follower.start(now)
        if follower.location is not None:
            back = replace(follower.location, arc_length=max(0.0, follower.location.arc_length - 1.0))
            lateral.append(path.advance(pose, back, 3.0 + 0.5 * abs(command.speed)).cross_track)
            ways.append(follower.location.arc_length)
        has_ended = follower.mode.state in (FollowerState.FINISHED, FollowerState.STOPPED)
        if has_ended or step * PERIOD_S > MAX_SECONDS or (ways and ways[-1] >= way):
            return Record(np.array(ways), np.array(lateral))
        vehicle.step(VehicleCommand(command.speed, command.yaw_rate), PERIOD_S)
    raise AssertionError


def run(options: argparse.Namespace) -> Report:
    """Drive the courses; a quick run one of them, by the seed."""
    report, is_quick = Report("following", notes=[__doc__ or ""]), options.size == "quick"
    courses, way = list(COURSES.items()), TUNED_M + QUICK_M if is_quick else math.inf
    if is_quick:
        courses = [courses[options.seed % len(courses)]]
    report.skipped = "" if (options.data / "tracks").is_dir() else f"no folder tracks in {options.data}"
    if not report.skipped:
        rows = [
            drive_course(name, options.data / "tracks", params_for(*limits), way, options.seed, report)
            for name, limits in courses
        ]
        columns = ("course, rmse m (largest)", "path_follower", *(f"{name}: gain" for name in RIVALS))
        report.tables.append(Table(f"Courses, judged behind the first {TUNED_M:g} m", columns, rows))
    return report


def params_for(speed: float, sideways: float) -> FollowerParams:
    """Return those of a car of 2.7 m wheelbase."""
    driving = SpeedParams(cruise=speed, lateral_acceleration=sideways)
    car = VehicleParams(wheelbase=2.7, max_speed=speed, max_acceleration=2.0, max_deceleration=2.0)
    return FollowerParams(speed=driving, vehicle=car)


def drive_course(
    name: str, folder: Path, params: FollowerParams, way: float, seed: int, report: Report
) -> tuple[str, ...]:
    """Drive one course by all; gains are chosen by another noise."""
    path = read_path(folder / f"{name}.csv", params)
    ours = drive(Follower(params, path), seed=seed, way=way)
    cells, others = [name, f"{ours.rmse(TUNED_M):.4f} ({largest(ours):.3f})"], dict[str, float]()
    for rival, (steer, gains) in RIVALS.items():
        tuned = [drive(Rival(params, path, steer, gain), seed=seed + 1, way=TUNED_M).rmse() for gain in gains]
        best = gains[int(np.nanargmin(tuned))]
        record = drive(Rival(params, path, steer, best), seed=seed, way=way)
        others[rival] = record.rmse(TUNED_M) if record.way[-1] >= min(way, path.length) - 1.0 else math.inf
        cells.append(f"{others[rival]:.4f} ({largest(record):.3f}): {best:g}")
    best_rival = min(others, key=others.__getitem__)
    of = Headline("drives and missions", f"course {name}", f"{best_rival}: {others[best_rival]:.3f} m")
    share = ours.rmse(TUNED_M) / others[best_rival]
    report.bounds += [
        Bound(f"{name}: lateral error, rmse", MAX_RMSE_M, ours.rmse(TUNED_M), "m", headline=of),
        Bound(f"{name}: rmse over that of the best of the others", 1.0, share, ""),
    ]
    return tuple(cells)


def largest(record: Record) -> float:
    """Return the largest distance from the path behind the part on which gains were chosen, in m."""
    return float(np.abs(record.lateral[record.way >= TUNED_M]).max(initial=0.0))
