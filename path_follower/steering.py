"""How to turn: the regulated errors (M15 eq. 22 to 24) and the second line of the control law (eq. 25).

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

from path_follower.constants import MAX_BANDWIDTH, MAX_OFF_HEADING
from path_follower.params import SteeringParams
from path_follower.path import Pose2, ReferencePoint, between
from path_follower.vehicle import clip


@dataclass(frozen=True)
class Errors:
    """e_x ahead of and e_y left of the reference in m, e_psi turned left of it in rad."""

    longitudinal: float
    lateral: float
    yaw: float


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
