"""What a new map goes without: key spheres that others replace, and what a budget does not hold."""

from __future__ import annotations

from collections.abc import Collection

from sphere_mapping.experiences.budget import Budget, thin
from sphere_mapping.graph.merging import merge
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry.arrays import Array
from sphere_nav.ros.maps.condensing import count_bytes
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.spheres.graph import SphereGraph


def thin_map(
    mapper: Mapper,
    maps: tuple[MapReader, MapReader | None],
    budget: Budget | None,
    graph: SphereGraph,
    positions: Array,
    new: Collection[int],
) -> tuple[SphereGraph, set[int], list[str]]:
    """Return the graph that is written, which of its key spheres are condensed, and what is told of that.

    maps: of the drive alone, and the one that it extends; positions (P, 3): of all spheres of the drive; new: key
    spheres that show what the map did not.
    """
    told, condensed, (drive, known) = [], set[int](), maps
    if mapper.params.key.merge:
        merged = merge(graph, positions, known.graph.nodes if known is not None else (), new)
        told += [f"{len(merged.replaced)} key spheres merged with others of their places"] * bool(merged.replaced)
        graph = merged.graph
    if budget is not None:

        def count(sphere_id: int, is_condensed: bool) -> float:
            holder = known if known is not None and sphere_id in known.graph.nodes else drive
            return count_bytes(holder, sphere_id, is_condensed)

        is_whole = mapper.load_sphere(mapper.tracks[0].key_id).camera.is_whole
        thinned = thin(graph, budget, count, is_whole=is_whole)
        graph, condensed = thinned.graph, thinned.condensed
        told += [f"{len(condensed)} key spheres are condensed for the budget"] * bool(condensed)
        told += [f"{thinned.num_left} key spheres left for the budget"] * bool(thinned.num_left)
    return graph, condensed, told
