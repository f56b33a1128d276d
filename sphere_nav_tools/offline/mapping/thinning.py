"""What a new map goes without: key spheres that others replace, and what a budget does not hold."""

from __future__ import annotations

from collections.abc import Collection

from sphere_mapping.experiences.budget import thin
from sphere_mapping.graph.merging import merge
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry.arrays import Array
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.spheres.graph import SphereGraph


def thin_map(
    mapper: Mapper,
    known: MapReader | None,
    budget: int | None,
    graph: SphereGraph,
    positions: Array,
    new: Collection[int],
) -> tuple[SphereGraph, list[str]]:
    """Return the graph that is written, and what is told of what it goes without.

    known: the map that the drive extends; budget: experiences that a place may hold; positions (P, 3): of all spheres
    of the drive; new: key spheres that show what the map did not.
    """
    told = []
    if mapper.params.key.merge:
        merged = merge(graph, positions, known.graph.nodes if known is not None else (), new)
        num_left = len(graph) - len(merged)
        told += [f"{num_left} key spheres merged with others of their places"] * bool(num_left)
        graph = merged
    if budget is not None:
        is_whole = mapper.load_sphere(mapper.tracks[0].key_id).camera.is_whole
        thinned = thin(graph, budget, is_whole=is_whole)
        num_left, graph = len(graph) - len(thinned), thinned
        told += [f"{num_left} key spheres left for the budget"] * bool(num_left)
    return graph, told
