"""Motion consistency of the follower: false stops a kilometre. What it must notice is measured by `faults`.

A simulated car follows winding roads by a localiser that knows the truth up to noise. What is nominal: the car slips,
its wheelbase, lags and straight-ahead position are not those of the parameters, a tenth of the poses is lost, 10 or 5
a second, with wheel odometry or without.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState, WheelErrors, WheelOdometry
from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams, SafetyParams
from path_follower.path import Pose2
from path_follower.reasons import StopReason
from path_follower.taught import Given, make_path
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array

LENGTH_M = 150.0  # of each drive
SECOND, STEP_NS, LATENCY_NS, ODOMETRY_NS = 1_000_000_000, 10_000_000, 50_000_000, 20_000_000
NOISE = (0.02, 0.02, math.radians(0.5))  # m, m, rad: standard deviations of the poses, stated truthfully
TRUTH = np.diag(np.square(NOISE))
SLIP, WHEELBASE_ERROR, LAG_ERROR, LOST, BIAS = 0.02, 0.03, 0.5, 0.1, math.radians(0.5)
FALSE_STOPS = 0.1  # a kilometre
DOUBTS = (
    StopReason.POSE_UNCERTAIN, StopReason.POSE_JUMP, StopReason.POSE_FROZEN, StopReason.POSE_INCONSISTENT,
    StopReason.NOT_MOVING, StopReason.ODOM_TIMEOUT,
)  # fmt: skip


class Drive:
    """A drive on a winding road; on after each stop."""

    def __init__(self, seed: int, period_ns: int, *, has_odometry: bool) -> None:
        self.rng = np.random.default_rng([seed, period_ns, has_odometry])
        self.period_ns, self.has_odometry, self.now, self.way, self.heard = period_ns, has_odometry, SECOND, 0.0, 0
        sign = self.rng.choice([-1.0, 1.0], 3)
        self.bias, lag = BIAS * sign[2], 0.2 * (1.0 + LAG_ERROR * sign[1])
        car = CarParams(wheelbase=1.2 * (1.0 + WHEELBASE_ERROR * sign[0]))
        self.vehicle = Vehicle(VehicleState(), car, ActuatorParams(steering_lag=lag, speed_lag=lag))
        # at 5 Hz two lost poses in a row are longer than the usual limit
        params = FollowerParams(safety=SafetyParams(max_pose_silence=max(0.4, 4.5e-9 * period_ns)))
        self.follower = Follower(params, make_path(Given(road(self.rng, LENGTH_M)), params))
        self.wheels = WheelOdometry(ODOMETRY_NS / SECOND, seed, WheelErrors(slip=SLIP))
        self.command, self.last_state = VehicleCommand(), FollowerState.IDLE
        self.pending: list[tuple[int, SE3]] = []
        self.stops: list[str] = []

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + round(seconds * SECOND)
        while self.now < end and self.follower.mode.state is not FollowerState.FINISHED:
            self._sense()
            self._tick()
            self.vehicle.step(self.command, STEP_NS / SECOND)
            self.wheels.step(self.vehicle.state.speed, self.vehicle.yaw_rate, STEP_NS / SECOND)
            self.way += abs(self.vehicle.state.speed) * STEP_NS / SECOND
            if self.follower.mode.state in (FollowerState.IDLE, FollowerState.STOPPED):
                self.follower.start(self.now)
            self.now += STEP_NS

    def _sense(self) -> None:
        if self.has_odometry and self.now % ODOMETRY_NS == 0:
            see, wheels = self.follower.watch.consistency.see_odometry, self.wheels
            see(Pose2(*wheels.pose), wheels.speed, wheels.yaw_rate, self.now)
        if self.now % self.period_ns == 0 and self.rng.random() >= LOST:
            noise = SE3.from_planar(*self.rng.normal(0.0, NOISE))
            self.pending.append((self.now, self.vehicle.state.T_world_base @ noise))

    def _tick(self) -> None:
        follower = self.follower
        if self.pending and self.pending[0][0] + LATENCY_NS <= self.now:
            stamp, pose = self.pending.pop(0)
            follower.watch.see_status("TRACKING", self.now)
            follower.see_pose(pose, stamp, None, TRUTH)
            self.heard = self.now
        elif self.now - self.heard <= 0.12 * SECOND or self.now % 25_000_000:
            return
        command = follower.tick(self.now)
        rate = command.speed * math.tan(command.steering_angle + self.bias) / self.vehicle.params.wheelbase
        self.command = VehicleCommand((1.0 - SLIP) * command.speed, (1.0 - SLIP) * rate)
        state = follower.mode.state
        if state is FollowerState.STOPPING and self.last_state is not state:
            self.stops.append(follower.mode.verdict.reason)
        self.last_state = state


def road(rng: np.random.Generator, length: float) -> Array:
    """Return points (N, 2) every 0.25 m of straights and bends down to 5 m radius."""
    bends: list[float] = [0.0] * 40
    while len(bends) < 4 * length:
        bend = float(rng.choice([0.0, 1.0])) * rng.uniform(-0.2, 0.2)
        bends += [bend] * int(rng.integers(12, 60))
    yaw = np.cumsum(np.array(bends) * 0.25)
    return np.cumsum(0.25 * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1), axis=0)


def run(options: argparse.Namespace) -> Report:
    """Drive in each setting."""
    seeds = range(options.seed, options.seed + (1 if options.size == "quick" else 20))
    rows, way, num_stops = list[tuple[str, ...]](), 0.0, 0
    settings = [(hertz, has_odometry) for hertz in (10, 5) for has_odometry in (False, True)]
    for hertz, has_odometry in settings:
        drives = [Drive(seed, SECOND // hertz, has_odometry=has_odometry) for seed in seeds]
        for drive in drives:
            drive.run(2.0 * LENGTH_M)
        found = [reason for drive in drives for reason in drive.stops if reason in DOUBTS]
        meters = sum(drive.way for drive in drives)
        way, num_stops = way + meters, num_stops + len(found)
        told = f"{hertz} Hz, odometry: {'yes' if has_odometry else 'no'}"
        rows.append((told, f"{meters / 1000.0:.2f}", str(len(found)), ", ".join(sorted(set(found))) or "–"))
    what = f"false stops a kilometre in {way / 1000.0:.2f} km, with the doubts on"
    of = Headline("robustness", f"{len(seeds)} drives in each of {len(settings)} settings")
    bound = Bound(what, FALSE_STOPS, 1000.0 * num_stops / way, "1/km", headline=of)
    return Report("doubts", [Table("Nominal", ("drives", "km", "false stops", "reasons"), rows)], [bound])
