"""What a new map goes without: key spheres that others replace, and what a budget does not hold."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from sphere_mapping.experiences.budget import Budget, thin
from sphere_mapping.graph.merging import merge
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry.arrays import Array
from sphere_nav.ros.maps.condensing import count_bytes
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.spheres.graph import SphereGraph


@dataclass(frozen=True, eq=False)
class Thinner:
    """A drive as it was mapped, the map of it alone, the map that it extends, and what the new one may take."""

    mapper: Mapper
    drive: MapReader
    known: MapReader | None
    budget: Budget | None

    def thin(
        self, graph: SphereGraph, positions: Array, new: Collection[int]
    ) -> tuple[SphereGraph, set[int], list[str]]:
        """Return the graph that is written, which of its key spheres are condensed, and what is told of that.

        positions (P, 3): of all spheres of the drive; new: key spheres that show what the map did not.
        """
        told, condensed = [], set[int]()
        if self.mapper.params.key.merge:
            merged = merge(graph, positions, self.known.graph.nodes if self.known is not None else (), new)
            number = len(merged.replaced)
            told += [f"{number} key spheres merged with others of their places"] if number else []
            graph = merged.graph
        if self.budget is not None:
            is_whole = self.mapper.load_sphere(self.mapper.tracks[0].key_id).camera.is_whole
            thinned = thin(graph, self.budget, self._count_bytes, is_whole=is_whole)
            graph, condensed = thinned.graph, thinned.condensed
            told += [f"{len(condensed)} key spheres are condensed for the budget"] if condensed else []
            told += [f"{thinned.num_left} key spheres left for the budget"] if thinned.num_left else []
        return graph, condensed, told

    def _count_bytes(self, sphere_id: int, is_condensed: bool) -> float:
        is_known = self.known is not None and sphere_id in self.known.graph.nodes
        return count_bytes(self.known if self.known is not None and is_known else self.drive, sphere_id, is_condensed)
