"""Places that a drive and a map have in common by what has stayed in the images, whatever the light.

Key spheres are aligned both ways by their parts, each from the first guess (`graph/both_ways.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from sphere_mapping.constants import GUESS_STEP_RAD, MAX_AWAY, NUM_HEADINGS, NUM_PARTS_SEARCHED
from sphere_mapping.graph.both_ways import align_parts, measure_motion_by_parts
from sphere_mapping.graph.extension import Submap, agreeing
from sphere_mapping.graph.registration import PreparedSphere
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Floats
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.range_alignment import RangeImage


def search_by_parts(base: Submap, drive: Submap, load_base: Callable[[int], RangeImage]) -> list[Edge]:
    """Return the places of some key spheres of the drive that their parts agree on, none where too few do.

    All pairs are compared small; the likeliest of each key sphere of the drive are measured as they are.
    """
    small = cache(lambda number: PreparedSphere(coarse_sphere(base.load(number))))
    edges = []
    for node in spread(drive.graph, NUM_PARTS_SEARCHED[0]):
        whole = PreparedSphere(drive.load(node.id))
        own, ranges, found = PreparedSphere(coarse_sphere(whole.sphere)), RangeImage.from_sphere(whole.sphere), []
        for one in spread(base.graph, NUM_PARTS_SEARCHED[1]):
            for heading in guess_headings(load_base(one.id), ranges).tolist():
                guess = SE3.from_planar(0.0, 0.0, heading)
                chance = align_parts(small(one.id), own, guess).chance
                if chance < 1.0:  # else as many agree anywhere
                    found.append((chance, one.id, guess))
        for _, a, guess in sorted(found, key=lambda pair: pair[0])[: NUM_PARTS_SEARCHED[2]]:
            motion = measure_motion_by_parts(PreparedSphere(base.load(a)), whole, guess)
            if motion is not None:
                edges.append(motion.edge(a, node.id, is_loop=True))
    return agreeing(base.graph, drive.graph, edges)


def refine_by_parts(base: Submap, drive: Submap, joined: SphereGraph) -> list[Edge]:
    """Return joins of the drive's key spheres with the nearest of the map that agree on where it was.

    `joined`: both, as far as it is known.
    """
    edges = []
    for node in drive.graph:
        T_map_sphere = joined[node.id].T_map_sphere
        nearest = base.graph.nearest(T_map_sphere.translation, 1)[0]
        T_a_b = nearest.T_map_sphere.inverse() @ T_map_sphere
        if np.linalg.norm(T_a_b.translation) > MAX_AWAY * (nearest.region_radius_m or 1.0):
            continue
        a, b = PreparedSphere(base.load(nearest.id)), PreparedSphere(drive.load(node.id))
        motion = measure_motion_by_parts(a, b, T_a_b)
        if motion is not None:
            edges.append(motion.edge(nearest.id, node.id, is_loop=True))
    return agreeing(base.graph, drive.graph, edges)


def spread(graph: SphereGraph, count: int) -> list[KeySphere]:
    """Return so many key spheres at most, evenly over the graph."""
    nodes = list(graph)
    return nodes[:: max(1, -(-len(nodes) // count))]


def guess_headings(a: RangeImage, b: RangeImage) -> Array:
    """Return the yaws of T_a_b that are worth trying: of whole spheres the best by N17's column shifts."""
    if not (a.camera.is_whole and b.camera == a.camera):
        return np.array([-GUESS_STEP_RAD, 0.0, GUESS_STEP_RAD])
    one, other = (_without_mean(np.log(part.range_m)) for part in (a, b))
    spectrum = np.fft.rfft(other, axis=1) * np.conj(np.fft.rfft(one, axis=1))
    likeness = np.fft.irfft(spectrum.sum(axis=0), a.camera.width)  # of `a` with `b` moved left by so many columns
    is_peak = (likeness >= np.roll(likeness, 1)) & (likeness > np.roll(likeness, -1))
    shifts = np.flatnonzero(is_peak)
    best = shifts[np.argsort(-likeness[shifts], kind="stable")[:NUM_HEADINGS]]
    return np.asarray(best * (2.0 * np.pi / a.camera.width), np.float64)


def _without_mean(image: Floats) -> Array:
    """Return an image (H, W) less the mean of each row, 0 where it is NaN."""
    known = np.ma.masked_invalid(image.astype(np.float64))
    return np.asarray((known - known.mean(axis=1, keepdims=True)).filled(0.0), np.float64)
