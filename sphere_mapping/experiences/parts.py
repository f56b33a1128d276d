"""Places that a drive and a map have in common by what has stayed in the images, whatever the light.

Key spheres are aligned both ways by their parts, each from the first guess (`graph/parts_motion.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from sphere_mapping.constants import NUM_KEPT_PREPARED, NUM_PARTS_SEARCHED, PARTS_REACH
from sphere_mapping.graph.extension import Submap, agreeing
from sphere_mapping.graph.parts_motion import align_parts, measure_motion_by_parts
from sphere_mapping.graph.registration import PreparedSphere
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

Headings = Callable[[int, int], Array]  # yaws of T_a_b that are worth trying, of a key sphere of either graph


class Prepared:
    """Key spheres of a submap as alignment needs them; the latest used are kept."""

    def __init__(self, submap: Submap) -> None:
        self.small = lru_cache(NUM_KEPT_PREPARED[0])(lambda number: PreparedSphere(coarse_sphere(submap.load(number))))
        self.whole = lru_cache(NUM_KEPT_PREPARED[1])(lambda number: PreparedSphere(submap.load(number)))


def search_by_parts(base: Submap, drive: Submap, headings: Headings) -> list[Edge]:
    """Return the places of some key spheres of the drive that their parts agree on, none where too few do.

    All pairs are compared small; the likeliest of each key sphere of the drive are measured as they are.
    """
    known, own = Prepared(base), Prepared(drive)
    edges = []
    for node in spread(drive.graph, NUM_PARTS_SEARCHED[0]):
        found = []
        for one in spread(base.graph, NUM_PARTS_SEARCHED[1]):
            for heading in headings(one.id, node.id).tolist():
                guess = SE3.from_planar(0.0, 0.0, heading)
                small = align_parts(known.small(one.id), own.small(node.id), guess)
                if small.chance < 1.0:  # else as many agree anywhere
                    found.append((small.chance, one.id, guess))
        for _, a, guess in sorted(found, key=lambda pair: pair[0])[: NUM_PARTS_SEARCHED[2]]:
            motion = measure_motion_by_parts(known.whole(a), own.whole(node.id), guess)
            if motion is not None:
                edges.append(motion.edge(a, node.id, is_loop=True))
    return agreeing(base.graph, drive.graph, edges)


def refine_by_parts(base: Submap, drive: Submap, joined: SphereGraph) -> list[Edge]:
    """Return joins of the drive's key spheres with the nearest of the map that agree on where it was.

    `joined`: both, as far as it is known.
    """
    known, own = Prepared(base), Prepared(drive)
    edges = []
    for node in drive.graph:
        T_map_sphere = joined[node.id].T_map_sphere
        nearest = base.graph.nearest(T_map_sphere.translation, 1)[0]
        T_a_b = nearest.T_map_sphere.inverse() @ T_map_sphere
        if np.linalg.norm(T_a_b.translation) > PARTS_REACH * (nearest.region_radius_m or 1.0):
            continue
        motion = measure_motion_by_parts(known.whole(nearest.id), own.whole(node.id), T_a_b)
        if motion is not None:
            edges.append(motion.edge(nearest.id, node.id, is_loop=True))
    return agreeing(base.graph, drive.graph, edges)


def spread(graph: SphereGraph, count: int) -> list[KeySphere]:
    """Return so many key spheres at most, evenly over the graph."""
    nodes = list(graph)
    return nodes[:: max(1, -(-len(nodes) // count))]
