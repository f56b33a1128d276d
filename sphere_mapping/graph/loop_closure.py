"""Places seen twice: proposed by distance, verified by dense alignment both ways, then the graph is corrected.

Thin form of M15 section 3.5.2: retrieval by appearance comes with whole spheres; the verification stays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from photometric import Alignment
from sphere_geometry import SE3
from sphere_map.graph import Edge, KeySphere, SphereGraph
from sphere_mapping.graph.keyframes import MAX_GREY
from sphere_mapping.graph.optimum import optimize_map
from sphere_mapping.graph.registration import PreparedSphere, align, edge_between
from sphere_mapping.params import LoopParams, MapperParams

MAX_MAD_SHARE, MIN_OVERLAP = 0.05, 0.3  # of a true loop: residual MAD by 255, share of the reference in view
MAX_DISAGREEMENT_M, MAX_DISAGREEMENT_RAD = 0.05, 0.02  # between the alignments both ways


@dataclass(frozen=True, eq=False)
class ClosedLoops:
    """The corrected graph, loop edges included, and how many were added."""

    graph: SphereGraph
    num_loops: int


def close_loops(graph: SphereGraph, params: MapperParams) -> ClosedLoops:
    """Return the graph with every verified loop among spheres in memory; the same graph where there is none."""
    prepared = {node.id: PreparedSphere(node.sphere, params.registration) for node in graph if node.sphere is not None}
    loops = []
    for older, newer in candidates(graph, params.loop):
        if older.id in prepared and newer.id in prepared:
            loop = verify(older, newer, prepared, params)
            if loop is not None:
                loops.append(loop)
    if not loops:
        return ClosedLoops(graph, 0)
    return ClosedLoops(optimize_map(SphereGraph(graph, [*graph.edges, *loops])).graph, len(loops))


def candidates(graph: SphereGraph, params: LoopParams) -> Iterator[tuple[KeySphere, KeySphere]]:
    """Yield pairs (older, newer) that are near each other but far apart in the sequence, and not yet joined."""
    joined = {(min(edge.a, edge.b), max(edge.a, edge.b)) for edge in graph.edges}
    for newer in graph:
        for older in graph.near(newer.T_map_sphere.translation, params.max_distance_m):
            if older.id <= newer.id - params.min_steps and (older.id, newer.id) not in joined:
                yield older, newer


def verify(
    older: KeySphere, newer: KeySphere, prepared: dict[int, PreparedSphere], params: MapperParams
) -> Edge | None:
    """Align both ways from the poses in the graph; return the edge if both are good and agree, else None."""
    forward = _align(prepared[newer.id], prepared[older.id], older.T_map_sphere, newer.T_map_sphere, params)
    if not _is_good(forward, prepared[older.id].coverage):
        return None
    back = _align(prepared[older.id], prepared[newer.id], forward.T_world_camera, older.T_map_sphere, params)
    if not _is_good(back, prepared[newer.id].coverage):
        return None
    distance, angle = back.T_world_camera.distance(older.T_map_sphere)
    if distance > MAX_DISAGREEMENT_M or angle > MAX_DISAGREEMENT_RAD:
        return None
    return edge_between(older, newer, forward, is_loop=True)


def _align(
    current: PreparedSphere, reference: PreparedSphere, T_map_reference: SE3, T_map_guess: SE3, params: MapperParams
) -> Alignment:
    return align(current, [reference.at(T_map_reference)], [T_map_guess], params.registration)


def _is_good(alignment: Alignment, coverage: float) -> bool:
    return (
        alignment.is_converged
        and alignment.mad <= MAX_MAD_SHARE * MAX_GREY
        and alignment.overlap >= MIN_OVERLAP * coverage
    )
