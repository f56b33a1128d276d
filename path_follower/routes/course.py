"""One path of a way over the network, from where the vehicle stands: points, headings and speeds for the follower.

Joining: the beginning of the path is the way of a car that is steered onto it by the law of the follower (its poles
belong to the way, not to time, see `steering.py`), with the wheel turning at a limited rate a metre and no further than
a share of what the car can. So the curve is feasible and the offset falls without overshoot. Where the vehicle heads
away from the path it grows no more than that curvature makes it: there the wheel goes as far as it may.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile

import numpy as np

from path_follower.constants import MAX_OFF_HEADING, MAX_POINTS, SPACING
from path_follower.params import SteeringParams, TurningParams
from path_follower.path import Pose2, between, wrap
from path_follower.routes.constants import JOIN_WITHIN, JOINED, LEAD, MAX_DETOUR, MAX_GROWTH, TURN_RATE, TURN_SHARE
from path_follower.routes.network import EdgeCurve, Network
from path_follower.routes.planning import Leg
from path_follower.vehicle import Motion, clip, drive
from sphere_nav.geometry.arrays import Array, arc_lengths


@dataclass(frozen=True, eq=False)
class Course:
    """Points (N,) in order of driving. They begin `lead` m behind a vehicle that joins.

    By joining the first leg is longer than on the network by `change` m. All takes `seconds`; of the legs each round
    at the end has `round_legs`.
    """

    x: Array
    y: Array
    yaw: Array  # of the vehicle, not of the way
    speed: Array
    legs: tuple[Leg, ...]
    change: float = 0.0
    lead: float = 0.0
    seconds: float = 0.0
    round_legs: int = 0

    @cached_property
    def ends(self) -> Array:
        """Where legs end (K,), m from the vehicle."""
        return self.change + np.cumsum([leg.length for leg in self.legs])

    @property
    def length(self) -> float:
        """Way in m."""
        return float(self.ends[-1]) if self.legs else 0.0

    def leg_at(self, way: float) -> int:
        """Return which leg a vehicle is on that has driven this far."""
        return min(int(np.searchsorted(self.ends, way, side="right")), len(self.legs) - 1)


NONE: Array = np.array(())
NO_COURSE = Course(NONE, NONE, NONE, NONE, ())


def make_course(network: Network, legs: Sequence[Leg], pose: Pose2 | None, vehicle: TurningParams) -> Course:
    """Return the path of legs, from a pose beside their beginning if given; ValueError where it cannot join."""
    points: list[Array] = []
    for number, leg in enumerate(legs):
        part = network.edges[leg.edge].curve.part(min(leg.first, leg.last), max(leg.first, leg.last))
        columns = part.columns.T[:: leg.direction]
        points.append(columns[1:] if number else columns)
    table, change, lead = np.concatenate(points), 0.0, 0.0
    if pose is not None:
        table, change, lead = _joined(table, legs[0].direction, _first_run(legs), pose, vehicle)
    if len(table) > MAX_POINTS:
        raise ValueError(f"way: expected at most {MAX_POINTS} points, found {len(table)}: fewer laps")
    x, y, yaw, speed = table.T
    return Course(x, y, yaw, speed, tuple(legs), change, lead)


def _first_run(legs: Sequence[Leg]) -> float:
    """Return how far it is to the first change of direction, or to the end."""
    return sum(leg.length for leg in takewhile(lambda leg: leg.direction == legs[0].direction, legs))


def _joined(
    table: Array, direction: int, run: float, pose: Pose2, vehicle: TurningParams
) -> tuple[Array, float, float]:
    """Return the points with their beginning replaced by the way onto them, how much longer that is, and the lead."""
    base, (x, y, yaw, driven) = arc_lengths(table[:, :2]), table.T
    curve = EdgeCurve(x, y, np.unwrap(yaw), driven)
    poses, s = join_curve(curve, direction, pose, vehicle, min(run, JOIN_WITHIN))
    rest = table[base > s + SPACING / 2]
    speed = np.interp(s * np.arange(len(poses)) / max(len(poses) - 1, 1), base, driven)
    joined = np.concatenate([np.column_stack([poses, speed]), rest])
    change = float(arc_lengths(joined[:, :2])[-1] - base[-1])
    behind = _behind(poses, direction)
    lead = np.column_stack([behind, np.full(len(behind), speed[0])])
    return np.concatenate([lead, joined]), change, SPACING * len(behind)


def _behind(poses: Array, direction: int) -> Array:
    """Return poses (M, 3) of the circle on which poses begin, LEAD m behind them: none for a vehicle on the path.

    The follower smooths what it is given; a curve that began at the vehicle would begin only half as sharp.
    """
    if len(poses) < 2:
        return np.empty((0, 3))
    first, bend = Pose2(*poses[0].tolist()), wrap(float(poses[1, 2] - poses[0, 2])) / SPACING
    back = Motion(-direction, math.atan(direction * bend))  # of a car whose wheelbase is 1 m
    return np.array([drive(first, back, 1.0, SPACING * count) for count in range(round(LEAD / SPACING), 0, -1)])


def join_curve(
    curve: EdgeCurve, direction: int, pose: Pose2, vehicle: TurningParams, reach: float
) -> tuple[Array, float]:
    """Return poses (K, 3) every SPACING m from a pose onto a curve in order of driving, and where on its arc they end.

    The law alone where the offset hardly grows by it; else with the wheel as far as it goes until the vehicle heads
    away no more. ValueError where it is not on the curve within `reach` m; a shorter curve is followed to its end.
    """
    poses, s, growth = _steered(curve, direction, pose, vehicle, reach, is_firm=False)
    if growth > MAX_GROWTH:
        poses, s, _ = _steered(curve, direction, pose, vehicle, reach, is_firm=True)
    return poses, s


def _steered(
    curve: EdgeCurve, direction: int, pose: Pose2, vehicle: TurningParams, reach: float, *, is_firm: bool
) -> tuple[Array, float, float]:
    """Return the poses, where they end, and the largest offset over the first one."""
    law, limit = SteeringParams(), TURN_SHARE * vehicle.max_steering_angle
    bend, s = direction * curve.bend, 0.0
    angle: float | None = None  # of the wheel: it may stand anyhow before the start
    poses, offsets = [pose], []
    while True:
        here = poses[-1]
        s = min(max(s + direction * between(curve.pose(s), here).x, 0.0), curve.length)
        _, left, turned = between(curve.pose(s), here)
        offsets.append(abs(left))
        if abs(left) <= JOINED[0] and abs(turned) <= JOINED[1]:
            return np.array(poses), s, max(offsets) / max(offsets[0], JOINED[0])
        if s >= reach - 1e-6 or len(poses) * SPACING > MAX_DETOUR * reach:
            found = f"{abs(left):.2f} m and {math.degrees(abs(turned)):.0f} deg beside it after {reach:.1f} m"
            raise ValueError(f"way: expected a vehicle that can drive onto the path, found {found}: bring it closer")
        error = clip(turned, MAX_OFF_HEADING)
        wanted = float(np.interp(s, curve.arc, bend)) - law.k_y * left - direction * law.k_psi * math.tan(error)
        wheel = math.atan(vehicle.virtual_wheelbase * wanted)
        if is_firm and direction * left * turned > 0.0:
            wheel = -direction * math.copysign(limit, turned)
        if angle is not None:
            wheel = angle + clip(wheel - angle, TURN_RATE * SPACING)
        angle = clip(wheel, limit)
        poses.append(drive(here, Motion(direction, angle), vehicle.virtual_wheelbase, SPACING))
