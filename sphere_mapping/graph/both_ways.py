"""Two spheres aligned both ways: what A says of B and what B says of A must be one motion (M15 eq. 11).

An alignment that ended in a wrong valley has rarely anything that holds it there from the other side: in a street, one
of a hundred pairs has, where "it did not move" explains rows of like windows from both sides. So features are heard,
too, where there are enough. What all agree on is an edge, with a covariance that knows how far they do not.

Head lamps move with the vehicle, and by night grey levels say that it stands; edges do not. Parts of the images
(`photometric/parts`) prove a motion if either way, each from the first guess, more parts agree than by chance, one in
so many of all that are tried, and both ways are one motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sphere_mapping.constants import (
    EDGE_FLOOR,
    MAX_FROM_FEATURES,
    MAX_PAIR_MAD,
    MAX_PARTS_CHANCE,
    MIN_INLIERS,
    MIN_NCC,
    MIN_PAIR_NCC,
    MIN_PAIR_OVERLAP,
)
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import REGISTRATION
from sphere_nav.estimation.least_squares import gate, squared_mahalanobis, symmetric_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric import Alignment, register
from sphere_nav.photometric.align.esm import GOOD
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.parts.registration import PartsAlignment, register_parts
from sphere_nav.spheres.appearance.pose import FeaturePose, find_pose
from sphere_nav.spheres.constants import EDGE_SHARE
from sphere_nav.spheres.graph import Edge
from sphere_nav.spheres.range_alignment import is_apart, meet

ONE_WAY, FEATURES = "ONE_WAY", "FEATURES"  # the way back does not agree; features agree on another motion


@dataclass(frozen=True, eq=False)
class TwoWayMotion:
    """T_a_b as both ways measured it, and the covariance (6, 6) of xi in T_a_b @ exp(xi)."""

    T_a_b: SE3
    covariance: Array

    def edge(self, a: int, b: int, *, is_loop: bool) -> Edge:
        """Return it as an edge of the graph."""
        return Edge(a, b, self.T_a_b, symmetric_inverse(self.covariance), is_loop)


@dataclass(frozen=True, eq=False)
class MeasuredMotion(TwoWayMotion):
    """The same by grey levels, with the alignment of B in the frame of A."""

    forward: Alignment


def measure_motion(a: PreparedSphere, b: PreparedSphere, T_a_b: SE3) -> MeasuredMotion | None:
    """Return the motion between two spheres from a first guess; None unless both ways are good and agree.

    The way back begins where the first one did, not where it ended: a common wrong valley is no agreement.
    """
    motion = _measure(a, b, T_a_b, T_a_b.inverse())
    return motion if motion is not None and not is_denied(motion.T_a_b, find_pose(b.features, a.features)) else None


def find_motion(a: PreparedSphere, b: PreparedSphere) -> MeasuredMotion | None:
    """Return the motion between two spheres of which nothing is known, however far they are; None unless it is proven.

    Features with the ranges of A give the first guess of the one way, those with the ranges of B that of the other: no
    way begins in a valley that the other one has found. Where one of them has too few, or they were of no use, both
    ways begin at what the more numerous ones say.
    """
    seen, seen_back = match_motion(a, b), match_motion(b, a)
    ways = [one for one in (seen, seen_back and replace(seen_back, T_sphere_camera=seen_back.T_sphere_camera.inverse()))
            if one is not None and one.num_inliers >= MIN_INLIERS]  # fmt: skip
    if not ways:
        return None
    best = max(ways, key=lambda one: one.num_inliers).T_sphere_camera
    starts = [(ways[0].T_sphere_camera, ways[1].T_sphere_camera)] if len(ways) == 2 else []
    for there, back in [*starts, (best, best)]:
        motion = _measure(a, b, there, back.inverse())
        if motion is not None:
            return None if any(is_denied(motion.T_a_b, one) for one in ways) else motion
    return None


def match_motion(a: PreparedSphere, b: PreparedSphere) -> FeaturePose | None:
    """Return T_a_b by features that are seen again from nearby, and the ranges of A."""
    return find_pose(b.fine_features, a.fine_features)


def _measure(a: PreparedSphere, b: PreparedSphere, T_a_b: SE3, T_b_a: SE3) -> MeasuredMotion | None:
    """Return what alignments from two first guesses agree on; None unless both are good."""
    forward = register(b.pyramid, [a.at(SE3.identity())], T_a_b, REGISTRATION)
    if not is_good(forward, a):
        return None
    back = register(a.pyramid, [b.at(SE3.identity())], T_b_a, REGISTRATION)
    return agree(forward, back) if is_good(back, b) else None


def is_denied(T_a_b: SE3, seen: FeaturePose | None) -> bool:
    """Say whether features that agree with each other do not agree with a motion; few features say nothing."""
    if seen is None or seen.num_inliers < MIN_INLIERS:
        return False
    distance, angle = T_a_b.distance(seen.T_sphere_camera)
    return bool(distance > MAX_FROM_FEATURES[0] or angle > MAX_FROM_FEATURES[1])


def confirm(a: PreparedSphere, b: PreparedSphere, forward: Alignment) -> MeasuredMotion | None:
    """Return the motion that an alignment of `b` in the frame of `a` measured, if the way back from there agrees."""
    back = register(a.pyramid, [b.at(SE3.identity())], forward.T_world_camera.inverse(), REGISTRATION)
    return agree(forward, back) if back.is_converged and back.ncc >= MIN_NCC else None


def why_denied(a: PreparedSphere, b: PreparedSphere, forward: Alignment, *, is_expected: bool) -> str:
    """Return why an alignment of `b` in the frame of `a` is not believed, or `GOOD`; an expected one by the way back.

    Of a sphere without range there is no way back. One that nothing foretold is held against features, too.
    """
    T_a_b = forward.T_world_camera
    if b.sphere.measured.any():
        motion = confirm(a, b, forward)
        if motion is None:
            return ONE_WAY
        T_a_b = motion.T_a_b
    return FEATURES if not is_expected and is_denied(T_a_b, match_motion(a, b)) else GOOD


def agree(forward: Alignment, back: Alignment) -> MeasuredMotion | None:
    """Return the motion between both results, None where they are too far apart."""
    T_there, T_back = forward.T_world_camera, back.T_world_camera
    if is_apart(T_there, T_back):
        return None
    adjoint = T_there.inverse().adjoint()
    fits = 0.5 * (forward.covariance + adjoint @ back.covariance @ adjoint.T)
    return MeasuredMotion(*meet(T_there, T_back, fits, EDGE_FLOOR), forward)


def least_variances(length_m: float) -> Array:
    """Return the variances (6,) that no measured motion of a length falls below."""
    return np.repeat([EDGE_FLOOR[0] + EDGE_SHARE * length_m, EDGE_FLOOR[1]], 3) ** 2


def is_good(alignment: Alignment, reference: PreparedSphere) -> bool:
    """Say whether one way alone could be true."""
    return (
        alignment.is_converged
        and alignment.mad <= MAX_PAIR_MAD
        and alignment.ncc >= MIN_PAIR_NCC
        and alignment.overlap >= MIN_PAIR_OVERLAP * reference.coverage
    )


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
    floor = np.diag(least_variances(float(np.linalg.norm(T_there.translation))))
    both = forward.covariance + adjoint @ back.covariance @ adjoint.T
    if squared_mahalanobis(gap, both + floor) > gate(6):
        return None
    return TwoWayMotion(*meet(T_there, T_back, 0.5 * both, EDGE_FLOOR))


def align_parts(a: PreparedSphere, b: PreparedSphere, T_a_b: SE3) -> PartsAlignment:
    """Return T_a_b by the image of `b` and the ranges of `a`."""
    return register_parts([RigImage(b.pyramid, views=(a.at(SE3.identity()),))], T_a_b, REGISTRATION)
