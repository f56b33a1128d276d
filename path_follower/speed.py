"""How fast: the speeds U* along the trajectory, and the first line of the control law (M15 eq. 25)."""

from __future__ import annotations

import numpy as np

from path_follower.command import TrackingError
from path_follower.constants import CREEP, EPSILON, GOAL_TOLERANCE, K_X
from path_follower.params import FollowerParams, SpeedParams, VehicleParams
from path_follower.path import ReferencePath, ReferencePoint
from path_follower.vehicle import Motion
from sphere_nav.geometry.arrays import Array


def speed_law(reference: ReferencePoint, e_x: float) -> float:
    """Return U = U* - k_x (|U*| + epsilon) e_x (eq. 25) in m/s, never against the direction of the segment."""
    speed = reference.speed - K_X * (abs(reference.speed) + EPSILON) * e_x
    return reference.direction * max(0.0, reference.direction * speed)


def eased_speed(
    path: ReferencePath, tracking: TrackingError, last: Motion, gain: float, vehicle: VehicleParams
) -> float:
    """Return the largest speed for which braking has to begin now, in m/s; `gain` m/s^2 is that of the last command.

    With bounded jerk j a speed that falls by d is followed late: by (g + d)^2 / (2 j d) until a gain g has become a
    loss d, and by d / (2 j) for being about to ease into the speed of the moment. So it is read that much earlier.
    """
    loss, jerk, rising = vehicle.max_deceleration, vehicle.max_jerk, max(gain, 0.0)
    late = ((rising + loss) ** 2 / loss + loss) / (2.0 * jerk)
    lead = (abs(last.speed) + rising**2 / (2.0 * jerk)) * late
    return abs(path.at(tracking.reference.arc_length + lead, tracking.location.segment).speed)


def bounded_speed(
    speed: float, tracking: TrackingError, params: FollowerParams, *, slow: float, is_starting: bool
) -> float:
    """Return the speed with its bounds: at most `slow`, creeping at a start and in the last steps of a segment."""
    direction = tracking.reference.direction
    if tracking.remaining <= GOAL_TOLERANCE:
        return 0.0
    largest = min(slow, CREEP) if is_starting else slow
    return direction * min(max(direction * speed, CREEP), largest)


def speed_limits(way: Array, bend: Array, driving: SpeedParams, vehicle: VehicleParams) -> Array:
    """Return the largest speed (N,) by cruise speed, lateral acceleration and steering rate on a curve.

    `way` (N,) m, `bend` (N,) 1/m. Steering angle and curvature are tied by tan(angle) = virtual wheelbase * curvature.
    """
    lateral = np.sqrt(driving.lateral_acceleration / np.maximum(np.abs(bend), 1e-6))
    angle = np.arctan(vehicle.virtual_wheelbase * bend)
    turning = np.abs(np.gradient(angle, way))
    by_rate = vehicle.max_steering_rate / np.maximum(turning, 1e-6)
    limit = np.minimum(np.minimum(lateral, by_rate), min(driving.cruise, vehicle.max_speed))
    return np.maximum(limit, CREEP)


def speed_profile(way: Array, limits: Array, vehicle: VehicleParams) -> Array:
    """Return the speed (N,) that keeps to the limits, brakes in time for them, and stops at the end.

    Braking: v^2 of a point <= v^2 of the next + 2 deceleration * distance. Speeding up likewise, but not from
    standstill at the start: there the acceleration limit of the command does it.
    """
    squared, left = np.append(np.square(limits[:-1]), 0.0), way[-1] - way
    braking, gaining = 2.0 * vehicle.max_deceleration * left, 2.0 * vehicle.max_acceleration * way
    squared = braking + np.minimum.accumulate((squared - braking)[::-1])[::-1]
    squared = gaining + np.minimum.accumulate(squared - gaining)
    return np.sqrt(np.maximum(squared, 0.0))
