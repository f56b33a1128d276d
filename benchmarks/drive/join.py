"""Starts beside a taught path: the way onto it, driven by the real control law and the car of the simulator.

Each start is up to 1 m beside the path and turned by up to 20 degrees, on a straight, in a bend, before or behind one;
it does not depend on how the others were driven. A car that heads away from the path, or across it, goes on while it
turns back. The best that any curve of the car can do is found by trying them: full lock to either side with the wheels
turned before it moves, changed over at up to two places, until the car heads as the path does; from there it can keep
its distance. Where the best is beyond 1.2 times the offset, no controller can keep that; all are judged by how much
further than the best they went.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
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
from path_follower.routes.network import EdgeCurve, Network, Spot
from path_follower.routes.planning import plan

HELP = "starts beside a taught path: is the car on it within 10 m, and how far beside it meanwhile?"
STARTS, QUICK = 50, 10
REACH, TURNED = 1.0, math.radians(20.0)  # m and rad beside
WITHIN, GROWTH = 10.0, 1.2
ON_PATH = 0.05  # m: the car is on the path from where it stays closer than this
CONTROL = 0.05  # m beyond the best curve, for wheels that take time to turn and poses with noise
NOISE = (0.01, 0.01, 0.003)  # m, m, rad of a pose
STEP = 0.05  # s between poses
TRIED_WITHIN, TRIED_STEP, CHANGES = 3.0, 0.02, 0.1  # m of a curve that is tried, of its steps, between its changes
COLUMNS = ("left m", "turned deg", "on the path after m", "largest offset m", "of the best curve m")
PARAMS = FollowerParams()


@dataclass(frozen=True)
class Join:
    """What became of a start: m, rad at the beginning; m until it was on the path; the largest offset; the least."""

    left: float
    turned: float
    way: float
    worst: float
    least: float  # largest offset of the best curve of the car

    @property
    def cells(self) -> tuple[str, ...]:
        """Its row."""
        offsets = (f"{self.worst:.3f}", f"{self.least:.3f}")
        return f"{self.left:+.2f}", f"{math.degrees(self.turned):+.0f}", f"{self.way:.1f}", *offsets


def run(options: argparse.Namespace) -> Report:
    """Drive from each start."""
    count, network = QUICK if options.size == "quick" else STARTS, straight_and_bends()
    generators = [np.random.default_rng([options.seed, number]) for number in range(count)]
    joins = [drive_onto(network, *draw(rng, network), rng) for rng in generators]
    report = Report("join", notes=[__doc__ or ""])
    report.tables.append(Table("starts", COLUMNS, [join.cells for join in joins]))
    growth = [join.worst / abs(join.left) for join in joins if join.least <= GROWTH * abs(join.left)]
    more = max(join.worst - join.least for join in joins)
    of = Headline("drives and missions", f"{count} starts up to 1 m and 20 deg beside a path", "any curve of the car")
    report.bounds += [
        at_least(f"join: on the path within {WITHIN:.0f} m", [join.way <= WITHIN for join in joins]),
        at_least("join: never beyond 1.2 x the offset where a car can", [one <= GROWTH for one in growth]),
        Bound("join: most beyond the best curve", CONTROL, more, "m", headline=of),
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
    way = ways[int(off[-1])] if len(off) else 0.0
    least = least_offset(edge.curve, found.s, left, turned, PARAMS.vehicle.max_curvature)
    return Join(float(left), float(turned), way, float(np.abs(offsets).max()), least)


def least_offset(curve: EdgeCurve, s: float, left: float, turned: float, bend: float) -> float:
    """Return the largest offset in m of the best of the curves tried, from a start beside a curve at `s` m.

    `bend` 1/m is the car's largest curvature. A curve counts until it heads as the path does.
    """
    at, count = curve.pose(s), round(TRIED_WITHIN / TRIED_STEP)
    places = range(0, count + 1, round(CHANGES / TRIED_STEP))
    bends = np.array([curved(count, sign * bend, a, b) for sign in (-1, 1) for a in places for b in places if a <= b])
    number = len(bends)
    x, y = np.full(number, at.x - left * math.sin(at.yaw)), np.full(number, at.y + left * math.cos(at.yaw))
    yaw, foot = np.full(number, at.yaw + turned), np.full(number, s)
    worst, is_turning = np.full(number, abs(left)), np.full(number, turned != 0.0)
    for step in range(count):
        turn = bends[:, step] * TRIED_STEP
        x, y = x + TRIED_STEP * np.cos(yaw + turn / 2), y + TRIED_STEP * np.sin(yaw + turn / 2)
        yaw = yaw + turn
        for _ in range(2):  # the foot of the car on the path
            there = np.stack([np.interp(foot, curve.arc, values) for values in (curve.x, curve.y, curve.yaw)])
            cosine, sine = np.cos(there[2]), np.sin(there[2])
            foot = foot + cosine * (x - there[0]) + sine * (y - there[1])
        offset = np.abs(cosine * (y - there[1]) - sine * (x - there[0]))
        worst = np.where(is_turning, np.maximum(worst, offset), worst)
        is_turning &= math.copysign(1.0, turned) * np.sin(yaw - there[2]) > 0.0
    return float(worst[~is_turning].min())


def curved(count: int, bend: float, first: int, last: int) -> NDArray[np.float64]:
    """Return the curvature (count,) of a curve that is `bend`, and the other way between two of its steps."""
    bends = np.full(count, bend)
    bends[first:last] *= -1.0
    return bends
