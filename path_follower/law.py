"""The control law: the regulated errors (M15 eq. 22 to 24), how to turn and how fast (eq. 25), and the speeds U*.

Gains from closed-loop poles. On the path the law gives d yaw / ds = curvature - k_y e_y - k_psi tan(e_psi), and the
car gives d e_y / ds = sin(e_psi), s being the way driven. To first order

    e_y'' + k_psi e_y' + k_y e_y = 0,    natural frequency w = sqrt(k_y) 1/m,    damping z = k_psi / (2 w).

The defaults, w = 0.9 1/m and z = 1, halve an offset within 1.9 m without overshoot. The poles belong to the way, not to
time, so that the vehicle moves on the same curve at every speed; but delays belong to time. What prediction leaves
over, a tenth of a second or two, is harmless as long as it stays below 0.65 / (w |U|) s, hence `MAX_BANDWIDTH`: above
that speed k_y and k_psi are scaled by f^2 and f, which keeps z. A slower loop passes more of the noise of headings on.

Backwards the car gives d e_y / ds = -sin(e_psi) for s > 0, so that the lateral term must change its sign to keep both
poles in the left half plane: k_y U* e_y, not the k_y |U*| e_y that eq. 25 prints for forward driving.

M15 puts the virtual vehicle a distance d ahead of the projected *measured* pose. In a turn of curvature c a vehicle on
the path then has e_y = c d^2 / 2 and e_psi = -c d, and settles c (k_psi d / k_y - d^2 / 2) beside it, decimetres for
d = 1 m: the peaks of Fig. 18. Here the virtual vehicle stands where the vehicle itself will be when the command acts,
and the errors are those of the *predicted* pose: the offset vanishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from path_follower.constants import CREEP, EPSILON, GOAL_TOLERANCE, K_X, MAX_BANDWIDTH, MAX_OFF_HEADING
from path_follower.params import SpeedParams, SteeringParams, VehicleParams
from path_follower.path import Location, Pose2, ReferencePath, ReferencePoint, between
from path_follower.vehicle import Motion, clip
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True)
class Errors:
    """e_x ahead of and e_y left of the reference in m, e_psi turned left of it in rad."""

    longitudinal: float
    lateral: float
    yaw: float


@dataclass(frozen=True)
class TrackingError:
    """The regulated errors (M15 eq. 22 to 24), the virtual vehicle they refer to, and the place on the path."""

    errors: Errors
    reference: ReferencePoint
    location: Location  # of the pose as measured
    remaining: float  # m from the predicted position to the end of the segment


def errors_of(pose: Pose2, reference: ReferencePoint) -> Errors:
    """Return e_q = R(yaw*)^T (o - o*) and e_psi = yaw - yaw* (eq. 22 to 24)."""
    return Errors(*between(Pose2(reference.x, reference.y, reference.yaw), pose))


def curvature_law(reference: ReferencePoint, errors: Errors, params: SteeringParams, speed: float) -> float:
    """Return the curvature in 1/m that eq. 25 asks for: yaw rate over U*, which also exists where U* is 0.

    U* times it is yaw rate = yaw rate* - k_y U* e_y - k_psi |U*| tan(e_psi). The wheel follows the curvature, so that a
    vehicle that is slower than U* drives the same curve. `speed` m/s is the actual one, for `MAX_BANDWIDTH`.
    """
    frequency = math.sqrt(params.k_y) * abs(speed)
    factor = min(1.0, MAX_BANDWIDTH / frequency) if frequency > 0 else 1.0
    yaw = clip(errors.yaw, MAX_OFF_HEADING)
    lateral = params.k_y * factor**2 * errors.lateral
    return reference.curvature - lateral - reference.direction * params.k_psi * factor * math.tan(yaw)


# --- speed
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


def bounded_speed(speed: float, tracking: TrackingError, *, slow: float, is_starting: bool) -> float:
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
