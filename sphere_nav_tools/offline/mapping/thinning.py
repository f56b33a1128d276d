"""What a new map goes without: key spheres that others replace, and what a budget does not hold."""

from __future__ import annotations

from collections.abc import Collection

from sphere_mapping.experiences.budget import describe_loss, thin
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
    told, kept = list[str](), graph
    if mapper.params.key.merge:
        kept = merge(graph, positions, known.graph.nodes if known is not None else (), new)
        told += describe_loss(graph, kept, "merged with others of their places")
    if budget is not None:
        merged, is_whole = kept, mapper.load_sphere(mapper.tracks[0].key_id).camera.is_whole
        kept = thin(merged, budget, is_whole=is_whole)
        told += describe_loss(merged, kept, "left for the budget")
    return kept, told
