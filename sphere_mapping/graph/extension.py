"""A drive joined to a map: places that both saw, found by appearance, verified densely and both ways (M15 3.5.2).

Nobody knows where in the map the drive was, so no drift can tell a place from one that looks like it. Instead several
places must say the same of where the drive is, as far as both graphs can have drifted between them, and more places
than say anything else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sphere_mapping.constants import (
    MAX_SEEDS,
    MIN_JOINS,
    MIN_LEAD,
)
from sphere_mapping.graph.loop_closure import drifted, lengths_from, seen_pairs
from sphere_mapping.graph.optimum import optimize_map
from sphere_mapping.graph.verification import Run, find_candidates, look_up, verify_all, verify_pairs
from sphere_nav.geometry import SE3
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere


@dataclass(frozen=True, eq=False)
class Submap:
    """A graph, what its key spheres look like, and who has their pictures; ids are unique among submaps."""

    graph: SphereGraph
    index: AppearanceIndex
    load: Callable[[int], Sphere]


@dataclass(frozen=True, eq=False)
class Joins:
    """Edges from the map to the drive that agree, and of how many key spheres, alike ones and aligned ones they are."""

    edges: list[Edge]
    num_spheres: int
    num_alike: int
    num_aligned: int

    def __str__(self) -> str:
        return (
            f"{self.num_spheres} key spheres looked up, {self.num_alike} like some of the map by their features, "
            f"{self.num_aligned} aligned with them both ways, {len(self.edges)} of these agree on one place"
        )


def find_joins(base: Submap, drive: Submap, run: Run = map) -> Joins:
    """Return the places that a drive has in common with a map, none where too few agree on where the drive is."""
    nodes = list(drive.graph)
    found = list(run(find_candidates, (look_up(base.index, drive.index.features[node.id]) for node in nodes)))
    alike = [(node.id, candidates) for node, candidates in zip(nodes, found, strict=True) if candidates]
    best = ((newer, sorted(found, key=lambda one: -one.num_inliers)) for newer, found in alike)
    aligned = verify_all(best, base.load, drive.load, run)
    return Joins(agreeing(base.graph, drive.graph, aligned), len(nodes), len(alike), len(aligned))


def agreeing(base: SphereGraph, drive: SphereGraph, edges: Sequence[Edge]) -> list[Edge]:
    """Return the largest number of edges that say the same of where the drive is.

    None where there are fewer than `MIN_JOINS`, or where nearly as many others agree on another place.
    """
    sets = [_like(seed, base, drive, edges) for seed in edges[:: max(len(edges) // MAX_SEEDS, 1)]]
    best = max(sets, key=len, default=[])
    rival = max((len([edge for edge in others if edge not in best]) for others in sets), default=0)
    return best if len(best) >= MIN_JOINS and len(best) >= MIN_LEAD * rival else []


def join_graphs(base: SphereGraph, drive: SphereGraph, edges: Sequence[Edge]) -> SphereGraph:
    """Return one graph, in the frame of the map, the drive at the poses that fit all edges best; joins are robust.

    The map stays where it is: what was driven by it before is driven as before.
    """
    T_base_drive = place_of_drive(base, drive, edges[len(edges) // 2])
    moved = drive.with_poses({node.id: T_base_drive @ node.T_map_sphere for node in drive})
    origin = KeySphere(-1, 0, SE3.identity())
    seen = [replace(edge, a=origin.id, T_a_b=base[edge.a].T_map_sphere @ edge.T_a_b) for edge in edges]
    placed = optimize_map(SphereGraph([origin, *moved], [*moved.edges, *seen]))
    nodes = [*base, *(node for node in placed if node.id != origin.id)]
    return SphereGraph(nodes, [*base.edges, *drive.edges, *edges])


def join_closely(base: Submap, drive: Submap, joined: SphereGraph, run: Run = map) -> SphereGraph:
    """Return a joined graph with edges between key spheres of the drive and those of the map that see the same.

    A join by the localizer is as good as one image; what both ways of two key spheres measure is as good as the map.
    """
    moved = SphereGraph(joined[node.id] for node in drive.graph)
    joins = [edge for edge in joined.edges if edge.a in base.graph.nodes and edge.b in drive.graph.nodes]
    is_whole = drive.load(min(drive.graph.nodes)).camera.is_whole
    pairs = seen_pairs(moved, base.graph, set(), is_whole=is_whole)
    return join_graphs(base.graph, drive.graph, [*joins, *verify_pairs(pairs, base.load, drive.load, run)])


def place_of_drive(base: SphereGraph, drive: SphereGraph, edge: Edge) -> SE3:
    """Return T_base_drive as one edge has it."""
    return base[edge.a].T_map_sphere @ edge.T_a_b @ drive[edge.b].T_map_sphere.inverse()


def _like(seed: Edge, base: SphereGraph, drive: SphereGraph, edges: Sequence[Edge]) -> list[Edge]:
    """Return the edges, the seed among them, that are where the drive's place by the seed lets them be."""
    T_base_drive = place_of_drive(base, drive, seed)
    in_base, in_drive = lengths_from(base, seed.a), lengths_from(drive, seed.b)

    def is_like(edge: Edge) -> bool:
        if edge.a not in in_base or edge.b not in in_drive:
            return False
        way = in_base[edge.a] + in_drive[edge.b]
        expected = drifted(T_base_drive @ drive[edge.b].T_map_sphere, way)
        return expected.allows(base[edge.a].T_map_sphere @ edge.T_a_b)

    return [edge for edge in edges if is_like(edge)]
