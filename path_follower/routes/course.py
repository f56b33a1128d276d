"""One path of a way over the network, from where the vehicle stands: points, headings and speeds for the follower.

Joining: the beginning of the path is the way of a car that is steered onto it by the law of the follower (its poles
belong to the way, not to time, see `steering.py`), with the wheel turning at a limited rate a metre and no further than
a share of what the car can. So the curve is feasible and the offset falls without overshoot. Where the vehicle heads
away from the path it grows no more than that curvature makes it: there the wheel goes as far as it may.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import takewhile

import numpy as np

from path_follower.constants import MAX_OFF_HEADING, MAX_POINTS, SPACING
from path_follower.params import SteeringParams, TurningParams
from path_follower.path import Pose2, between, wrap
from path_follower.routes.constants import JOIN_WITHIN, JOINED, LEAD, MAX_DETOUR, MAX_GROWTH, TURN_RATE, TURN_SHARE
from path_follower.routes.network import EdgeCurve, Network
from path_follower.routes.planning import Route
from path_follower.vehicle import Motion, clip, drive
from sphere_nav.geometry.arrays import Array, arc_lengths


def make_course(network: Network, route: Route, pose: Pose2 | None, vehicle: TurningParams) -> tuple[Route, Array]:
    """Return a route from a pose beside its beginning if given, and the path: points (N, 4) in order of driving.

    Their columns are x, y, yaw of the vehicle, not of the way, and speed. ValueError where it cannot join.
    """
    parts = [
        network.edges[leg.edge].curve.part(*sorted((leg.first, leg.last))).columns.T[:: leg.direction]
        for leg in route.legs
    ]
    points = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    if pose is not None:
        route, points = _joined(route, points, pose, vehicle)
    if len(points) > MAX_POINTS:
        raise ValueError(f"way: expected at most {MAX_POINTS} points, found {len(points)}: fewer laps")
    return route, points


def _joined(route: Route, points: Array, pose: Pose2, vehicle: TurningParams) -> tuple[Route, Array]:
    """Return them with the beginning replaced by the way onto the path, before the first change of direction."""
    base, (x, y, yaw, driven) = arc_lengths(points[:, :2]), points.T
    direction = route.legs[0].direction
    run = sum(leg.length for leg in takewhile(lambda leg: leg.direction == direction, route.legs))
    curve = EdgeCurve(x, y, np.unwrap(yaw), driven)
    poses, s = join_curve(curve, direction, pose, vehicle, min(run, JOIN_WITHIN))
    speed = np.interp(s * np.arange(len(poses)) / max(len(poses) - 1, 1), base, driven)
    joined = np.concatenate([np.column_stack([poses, speed]), points[base > s + SPACING / 2]])
    behind = _behind(poses, direction)
    lead = np.column_stack([behind, np.full(len(behind), speed[0])])
    change = float(arc_lengths(joined[:, :2])[-1] - base[-1])
    return replace(route, change=change, lead=SPACING * len(behind)), np.concatenate([lead, joined])


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
