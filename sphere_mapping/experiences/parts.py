"""Places that a drive and a map have in common by what has stayed in the images, whatever the light.

Key spheres are aligned by their parts (`photometric/parts`), both ways, each from the first guess. A motion counts if
either way more parts agree than by chance, one in so many of all that are tried, and both ways are one motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sphere_mapping.constants import (
    EDGE_FLOOR,
    MAX_PARTS_APART,
    MAX_PARTS_CHANCE,
    NUM_KEPT_PREPARED,
    NUM_PARTS_SEARCHED,
    PARTS_REACH,
)
from sphere_mapping.graph.extension import Submap, agreeing
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import MappingRegistrationParams
from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.estimation.normal_equations import symmetric_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.parts.registration import PartsAlignment, register_parts
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.constants import EDGE_SHARE
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

Headings = Callable[[int, int], Array]  # yaws of T_a_b that are worth trying, of a key sphere of either graph


class Prepared:
    """Key spheres of a submap as alignment needs them; the latest used are kept."""

    def __init__(self, submap: Submap, params: MappingRegistrationParams) -> None:
        self.small = lru_cache(NUM_KEPT_PREPARED[0])(
            lambda number: PreparedSphere(coarse_sphere(submap.load(number)), params)
        )
        self.whole = lru_cache(NUM_KEPT_PREPARED[1])(lambda number: PreparedSphere(submap.load(number), params))


@dataclass(frozen=True, eq=False)
class PartsMotion:
    """T_a_b as both ways measured it, its covariance (6, 6), and the larger of both chances."""

    T_a_b: SE3
    covariance: Array
    chance: float

    def edge(self, a: int, b: int) -> Edge:
        """Return it as a robust edge of the graph."""
        return Edge(a, b, self.T_a_b, symmetric_inverse(self.covariance), is_loop=True)


def measure_motion_by_parts(
    a: PreparedSphere, b: PreparedSphere, T_a_b: SE3, params: MappingRegistrationParams
) -> PartsMotion | None:
    """Return the motion between two spheres from a first guess; None unless both ways are proven and are one motion."""
    forward = align_parts(a, b, T_a_b, params)
    if forward.chance > MAX_PARTS_CHANCE:
        return None
    back = align_parts(b, a, T_a_b.inverse(), params)
    if back.chance > MAX_PARTS_CHANCE:
        return None
    T_there, T_back = forward.T_world_body, back.T_world_body
    gap = (T_back @ T_there).log()  # A -> B composed with B -> A, axes of B
    adjoint = T_there.inverse().adjoint()
    length_m = float(np.linalg.norm(T_there.translation))
    floor = np.diag(np.repeat([EDGE_FLOOR[0] + EDGE_SHARE * length_m, EDGE_FLOOR[1]], 3) ** 2)
    both = forward.covariance + adjoint @ back.covariance @ adjoint.T
    if squared_mahalanobis(gap, both + floor) > MAX_PARTS_APART**2:
        return None
    apart = np.repeat([np.sum(gap[:3] ** 2) / 12, np.sum(gap[3:] ** 2) / 12], 3)
    covariance = 0.5 * both + floor + np.diag(apart)
    return PartsMotion(T_there @ SE3.exp(-0.5 * gap), covariance, max(forward.chance, back.chance))


def align_parts(a: PreparedSphere, b: PreparedSphere, T_a_b: SE3, params: MappingRegistrationParams) -> PartsAlignment:
    """Return T_a_b by the image of `b` and the ranges of `a`."""
    return register_parts([RigImage(b.pyramid, views=(a.at(SE3.identity()),))], T_a_b, params)


def search_by_parts(base: Submap, drive: Submap, params: MappingRegistrationParams, headings: Headings) -> list[Edge]:
    """Return the places of some key spheres of the drive that their parts agree on, none where too few do.

    All pairs are compared small; the likeliest of each key sphere of the drive are measured as they are.
    """
    known, own = Prepared(base, params), Prepared(drive, params)
    edges = []
    for node in spread(drive.graph, NUM_PARTS_SEARCHED[0]):
        found = []
        for one in spread(base.graph, NUM_PARTS_SEARCHED[1]):
            for heading in headings(one.id, node.id).tolist():
                guess = SE3.from_planar(0.0, 0.0, heading)
                small = align_parts(known.small(one.id), own.small(node.id), guess, params)
                if small.chance < 1.0:  # else as many agree anywhere
                    found.append((small.chance, one.id, guess))
        for _, a, guess in sorted(found, key=lambda pair: pair[0])[: NUM_PARTS_SEARCHED[2]]:
            motion = measure_motion_by_parts(known.whole(a), own.whole(node.id), guess, params)
            if motion is not None:
                edges.append(motion.edge(a, node.id))
    return agreeing(base.graph, drive.graph, edges)


def refine_by_parts(base: Submap, drive: Submap, joined: SphereGraph, params: MappingRegistrationParams) -> list[Edge]:
    """Return joins of the drive's key spheres with the nearest of the map that agree on where it was.

    `joined`: both, as far as it is known.
    """
    known, own = Prepared(base, params), Prepared(drive, params)
    edges = []
    for node in drive.graph:
        T_map_sphere = joined[node.id].T_map_sphere
        nearest = base.graph.nearest(T_map_sphere.translation, 1)[0]
        T_a_b = nearest.T_map_sphere.inverse() @ T_map_sphere
        if np.linalg.norm(T_a_b.translation) > PARTS_REACH * (nearest.region_radius_m or 1.0):
            continue
        motion = measure_motion_by_parts(known.whole(nearest.id), own.whole(node.id), T_a_b, params)
        if motion is not None:
            edges.append(motion.edge(nearest.id, node.id))
    return agreeing(base.graph, drive.graph, edges)


def spread(graph: SphereGraph, count: int) -> list[KeySphere]:
    """Return so many key spheres at most, evenly over the graph."""
    nodes = list(graph)
    return nodes[:: max(1, -(-len(nodes) // count))]
