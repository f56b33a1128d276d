"""What stands in the way: points of a scan in the footprint that the vehicle sweeps until it could stand."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from path_follower.constants import ACROSS, REACTION, SWEEP_STEP
from path_follower.params import FollowerParams
from path_follower.path import Location, Pose2, ReferencePath, between
from path_follower.vehicle import ORIGIN, Motion, drive
from sphere_nav.geometry.arrays import Array


def stopping_distance(speed: float, params: FollowerParams) -> float:
    """Return the way in m until the vehicle stands at ordinary deceleration, reaction and one step included."""
    v = abs(speed)
    return v * REACTION + v * v / (2.0 * params.vehicle.max_deceleration) + SWEEP_STEP


def points_in_way(
    points: Array, pose: Pose2, path: ReferencePath, location: Location, distance: float, params: FollowerParams
) -> int:
    """Count points (N, 2) of the vehicle's frame in the footprints along the next `distance` m of the path.

    The footprints keep the present offset from the path. Points on the body itself are its own.
    """
    here, places = path.at(location.arc_length, location.segment), []
    for ahead in _steps(distance):
        there = path.at(location.arc_length + ahead, location.segment)
        places.append(between(Pose2(here.x, here.y, pose.yaw), Pose2(there.x, there.y, there.yaw)))
    return _count(points, places, params)


def points_on_arc(points: Array, steering_angle: float, distance: float, params: FollowerParams) -> int:
    """Count points (N, 2) of the vehicle's frame in the footprints of the next `distance` m with the wheel as it is."""
    return _count(points, _arc(Motion(1.0, steering_angle), distance, params), params)


def swept_places(motion: Motion, params: FollowerParams) -> Array:
    """Return points (N, 2) of the vehicle's frame that the body sweeps until it could stand, driving at full speed.

    `motion`: of its speed only the sign counts, that nothing be seen better for driving slowly, and its wheel.
    """
    body, sign = params.vehicle, math.copysign(1.0, motion.speed)
    half = body.width / 2.0 + params.safety.obstacle_margin
    end, across = (body.front if sign > 0 else -body.rear), np.linspace(-half, half, ACROSS)
    here = _arc(Motion(sign, motion.steering_angle), stopping_distance(params.speed.cruise, params), params)
    x, y, yaw = np.array(here).T[..., None]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.stack([x + end * cosine - across * sine, y + end * sine + across * cosine], axis=-1).reshape(-1, 2)


def _arc(motion: Motion, distance: float, params: FollowerParams) -> list[Pose2]:
    """Return the poses of a motion at 1 m/s over the next `distance` m."""
    return [drive(ORIGIN, motion, params.vehicle.virtual_wheelbase, float(ahead)) for ahead in _steps(distance)]


def _steps(distance: float) -> Array:
    return np.arange(SWEEP_STEP, distance + SWEEP_STEP, SWEEP_STEP)


def _count(points: Array, places: Iterable[Pose2], params: FollowerParams) -> int:
    body, margin = params.vehicle, params.safety.obstacle_margin
    half = body.width / 2.0
    own = (points[:, 0] > -body.rear) & (points[:, 0] < body.front) & (np.abs(points[:, 1]) < half)
    others = points[~own]
    hit = np.zeros(len(others), dtype=bool)
    for place in places:
        way = others - [place.x, place.y]
        along = way @ [math.cos(place.yaw), math.sin(place.yaw)]
        across = way @ [-math.sin(place.yaw), math.cos(place.yaw)]
        hit |= (along > -body.rear - margin) & (along < body.front + margin) & (np.abs(across) < half + margin)
    return int(hit.sum())
