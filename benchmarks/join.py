"""Starts beside a taught path: the way onto it, driven by the real control law and the car of the simulator.

Each start is up to 1 m beside the path and turned by up to 20 degrees, on a straight, in a bend, before or behind one.
A car that heads away from the path, or across it, goes on while it turns back: full lock at once costs R (1 - cos
turned), R by the car's curvature less that of the path. Where 1.2 times the offset is less than that and
CONTROL, for wheels that take time to turn and poses with noise, no curve of the car can keep it: such starts are judged
by what full lock reaches. Seeds 1 to 20 were looked at while the curve was chosen; figures are of
seed 101 on.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState
from cycab_sim.world.paths import Path, Piece, turn
from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams
from path_follower.path import Pose2
from path_follower.path_files import make_path
from path_follower.routes.building import TaughtDrive, build_network, even_curve
from path_follower.routes.course import make_course
from path_follower.routes.network import Network, Spot
from path_follower.routes.planning import plan

HELP = "starts beside a taught path: is the car on it within 10 m, and how far beside it meanwhile?"
STARTS, QUICK = 50, 10
REACH, TURNED = 1.0, math.radians(20.0)  # m and rad beside
WITHIN, GROWTH = 10.0, 1.2
ON_PATH = 0.05  # m: the car is on the path from where it stays closer than this
CONTROL = 0.05  # m
NEXT = 5.0  # m in which it turns back
NOISE = (0.01, 0.01, 0.003)  # m, m, rad of a pose
STEP = 0.05  # s between poses
PARAMS = FollowerParams()


@dataclass(frozen=True)
class Join:
    """What became of a start: m, rad at the beginning; m until it was on the path; the largest offset."""

    left: float
    turned: float
    way: float
    worst: float
    bend: float  # 1/m, largest of the path's next metres to the side to which the car has to turn

    @property
    def unavoidable(self) -> float:
        """The largest offset at full lock from the first moment on."""
        turn = (1.0 - math.cos(self.turned)) / (PARAMS.vehicle.max_curvature - self.bend)
        is_away = self.left * self.turned > 0.0
        return abs(self.left) + turn if is_away else max(abs(self.left), turn - abs(self.left))

    @property
    def growth(self) -> float:
        """Largest offset over the first one."""
        return float(self.worst / abs(self.left))


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--join-seed", type=int, default=101, help="of the starts (101)")


def run(options: argparse.Namespace) -> Report:
    """Drive from each start."""
    count = QUICK if options.quick else STARTS
    rng = np.random.default_rng(options.join_seed)
    network = straight_and_bends()
    joins = [drive_onto(network, *draw(rng, network), rng) for _ in range(count)]
    report = Report("join", notes=[describe(options.threads), __doc__ or ""])
    avoidable = [join for join in joins if join.unavoidable + CONTROL <= GROWTH * abs(join.left)]
    more = max(join.worst - join.unavoidable for join in joins)
    rows = [
        (f"{j.left:+.2f}", f"{math.degrees(j.turned):+.0f}", f"{j.way:.1f}", f"{j.worst:.2f}", f"{j.growth:.2f}")
        for j in joins
    ]
    report.tables.append(
        Table("starts", ("left m", "turned deg", "on the path after m", "largest offset m", "growth"), rows)
    )
    report.bounds += [
        at_least(f"join: on the path within {WITHIN:.0f} m", [j.way <= WITHIN for j in joins]),
        at_least("join: never beyond 1.2 x the offset where a car can", [j.growth <= GROWTH for j in avoidable]),
        Bound("join: beyond what full lock reaches", CONTROL, more, "m"),
        at_least("join: never beyond 1.2 x the offset, all starts", [j.growth <= GROWTH for j in joins]),
    ]
    return report


def at_least(what: str, kept: list[bool]) -> Bound:
    """Return the bound that all of them are kept."""
    return Bound(f"{what}, of {len(kept)}", len(kept), sum(kept), "", is_minimum=True)


def straight_and_bends() -> Network:
    """Return a network of one path: straights and bends of 6 and 10 m radius to both sides."""
    pieces = (Piece(30.0), turn(6.0, 90), Piece(20.0), turn(10.0, -90), Piece(20.0), turn(6.0, -60), Piece(40.0))
    path = Path((0.0, 0.0, 0.0), pieces)
    x, y, yaw, _ = path.at(np.arange(0.0, path.length, 0.1)).T
    return build_network([TaughtDrive(even_curve(x, y, yaw, np.full(len(x), 1.4)))], "map")


def draw(rng: np.random.Generator, network: Network) -> tuple[Spot, float, float]:
    """Return a spot of the path, m to the left of it and rad turned."""
    edge = next(iter(network.edges.values()))
    spot = Spot(edge.id, float(rng.uniform(0.0, edge.length - 30.0)))
    return spot, float(rng.uniform(-REACH, REACH)), float(rng.uniform(-TURNED, TURNED))


def drive_onto(network: Network, spot: Spot, left: float, turned: float, rng: np.random.Generator) -> Join:
    """Drive 20 m from a start; lengths are those of the path, not of the car's way."""
    edge = network.edges[spot.edge]
    at = edge.curve.pose(spot.s)
    pose = Pose2(at.x - left * math.sin(at.yaw), at.y + left * math.cos(at.yaw), at.yaw + turned)
    found = network.locate(pose, REACH + 0.05, TURNED + 0.05)[0]
    course = make_course(
        network, plan(network, [found], [Spot(edge.id, edge.length)], cruise=1.4).legs, pose, PARAMS.vehicle
    )
    points = np.stack([course.x, course.y], axis=-1)
    follower = Follower(PARAMS, make_path(points, course.yaw, course.speed, PARAMS))
    car = Vehicle(VehicleState(*pose), CarParams(), ActuatorParams())
    s, now, offsets, ways, is_started = found.s, 1_000_000_000, [left], [0.0], False
    while s < found.s + 20.0 and now < 60_000_000_000:
        state = car.state
        measured = Pose2(*(np.array((state.x, state.y, state.yaw)) + rng.normal(size=3) * NOISE))
        command = follower.update(measured, None, now, "TRACKING")
        if not is_started:
            refusal = follower.start(now)
            if refusal:
                raise RuntimeError(refusal)
            is_started = True
        elif follower.mode.state is FollowerState.STOPPED:
            raise RuntimeError(str(follower.mode.verdict))
        for _ in range(5):
            car.step(VehicleCommand(command.speed, command.yaw_rate), STEP / 5)
        now += round(STEP * 1e9)
        there = edge.curve.pose(s)
        dx, dy = car.state.x - there.x, car.state.y - there.y
        s += math.cos(there.yaw) * dx + math.sin(there.yaw) * dy
        there = edge.curve.pose(s)
        offsets.append(math.cos(there.yaw) * (car.state.y - there.y) - math.sin(there.yaw) * (car.state.x - there.x))
        ways.append(s - found.s)
    off = np.flatnonzero(np.abs(offsets) > ON_PATH)
    near = (edge.curve.arc >= found.s) & (edge.curve.arc <= found.s + NEXT)
    bend = max(0.0, float((-math.copysign(1.0, turned) * edge.curve.bend[near]).max()))
    return Join(float(left), float(turned), ways[int(off[-1])] if len(off) else 0.0, float(np.abs(offsets).max()), bend)
