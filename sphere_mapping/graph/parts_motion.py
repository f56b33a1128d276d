"""Two spheres aligned both ways by what has stayed of their images, whatever the light (`photometric/parts`).

Head lamps move with the vehicle, and by night grey levels say that it stands; edges do not. A motion counts if either
way, each from the first guess, more parts agree than by chance, one in so many of all that are tried, and both ways are
one motion.
"""

from __future__ import annotations

import numpy as np

from sphere_mapping.constants import EDGE_FLOOR, MAX_PARTS_CHANCE
from sphere_mapping.graph.both_ways import TwoWayMotion
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import REGISTRATION
from sphere_nav.estimation.least_squares import gate, squared_mahalanobis
from sphere_nav.geometry import SE3
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.parts.registration import PartsAlignment, register_parts
from sphere_nav.spheres.constants import EDGE_SHARE
from sphere_nav.spheres.range_alignment import meet


def measure_motion_by_parts(a: PreparedSphere, b: PreparedSphere, T_a_b: SE3) -> TwoWayMotion | None:
    """Return the motion between two spheres from a first guess; None unless both ways are proven and are one motion."""
    forward = align_parts(a, b, T_a_b)
    if forward.chance > MAX_PARTS_CHANCE:
        return None
    back = align_parts(b, a, T_a_b.inverse())
    if back.chance > MAX_PARTS_CHANCE:
        return None
    T_there, T_back = forward.T_world_body, back.T_world_body
    gap = (T_back @ T_there).log()  # A -> B composed with B -> A, axes of B
    adjoint = T_there.inverse().adjoint()
    length_m = float(np.linalg.norm(T_there.translation))
    floor = np.diag(np.repeat([EDGE_FLOOR[0] + EDGE_SHARE * length_m, EDGE_FLOOR[1]], 3) ** 2)
    both = forward.covariance + adjoint @ back.covariance @ adjoint.T
    if squared_mahalanobis(gap, both + floor) > gate(6):
        return None
    return TwoWayMotion(*meet(T_there, T_back, 0.5 * both, EDGE_FLOOR))


def align_parts(a: PreparedSphere, b: PreparedSphere, T_a_b: SE3) -> PartsAlignment:
    """Return T_a_b by the image of `b` and the ranges of `a`."""
    return register_parts([RigImage(b.pyramid, views=(a.at(SE3.identity()),))], T_a_b, REGISTRATION)
