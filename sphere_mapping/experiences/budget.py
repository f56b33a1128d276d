"""What leaves a map that holds too much: what explained least in the last drives, never the only one of a place."""

from __future__ import annotations

import re
from dataclasses import dataclass

from sphere_mapping.graph.merging import Merged, drop
from sphere_nav.spheres.experiences import find_places
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph


@dataclass(frozen=True)
class Budget:
    """How many experiences a place may hold, or how many bytes the key spheres of a map may take; 0: any."""

    num_experiences: int = 0
    num_bytes: float = 0.0

    @staticmethod
    def parse(text: str) -> Budget:
        """Return the budget of `3` or `200MB`; ValueError for anything else."""
        found = re.fullmatch(r"([1-9][0-9]{0,6})(MB)?", text.strip())
        if found is None:
            raise ValueError(f"expected experiences a place, as 3, or megabytes, as 200MB, found {text[:40]!r}")
        number = int(found[1])
        return Budget(num_bytes=number * 1e6) if found[2] else Budget(number)


def thin(graph: SphereGraph, budget: Budget, bytes_per_sphere: float, *, is_whole: bool) -> Merged:
    """Return the graph within a budget, as far as places keep one key sphere each; the least serving ones leave first.

    `is_whole`: its spheres see in every direction.
    """
    left, leaving = graph, list[int]()
    while True:
        places = find_places(left, is_whole=is_whole)
        if budget.num_experiences:
            crowded = {node_id for node_id, found in places.items() if len(found) > budget.num_experiences}
        else:
            is_full = len(left) * bytes_per_sphere > budget.num_bytes
            crowded = {node_id for node_id, found in places.items() if is_full and len(found) > 1}
        least = [left[node_id] for node_id in crowded if _is_least(left[node_id], places[node_id])]
        if not least:
            return drop(graph, leaving)
        gone = min(least, key=lambda node: (node.served, node.id))
        leaving.append(gone.id)
        left = SphereGraph(node for node in left if node.id != gone.id)


def _is_least(node: KeySphere, found: dict[Experience, float]) -> bool:
    """Say whether no other experience at the place of a key sphere served less than its own."""
    return found[node.experience] <= min(found.values())
