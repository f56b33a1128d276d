"""What a map with too many experiences of a place goes without: the key spheres that explained least.

Of a place those leave first that explain the fewest images of a drive in their light. The only one never leaves.
"""

from __future__ import annotations

from sphere_mapping.graph.merging import drop
from sphere_nav.spheres.experiences import find_places
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph


def thin(graph: SphereGraph, num_experiences: int, *, is_whole: bool) -> SphereGraph:
    """Return the graph with at most so many experiences of a place; the least serving ones go first.

    `is_whole`: its spheres see in every direction.
    """
    left, leaving = graph, list[int]()
    while True:
        places = find_places(left, is_whole=is_whole)
        crowded = [left[node_id] for node_id, found in places.items() if len(found) > num_experiences]
        least = [node for node in crowded if _is_least(node, places[node.id])]
        if not least:
            return drop(graph, leaving)
        gone = min(least, key=lambda node: (node.served, node.id))
        leaving.append(gone.id)
        left = SphereGraph(node for node in left if node.id != gone.id)


def _is_least(node: KeySphere, found: dict[Experience, float]) -> bool:
    """Say whether no other experience at the place of a key sphere served less than its own."""
    return found[node.experience] <= min(found.values())


def describe_loss(before: SphereGraph, after: SphereGraph, why: str) -> list[str]:
    """Return in words how many key spheres a graph goes without, nothing where it is none."""
    number = len(before) - len(after)
    return [f"{number} key spheres {why}"] if number else []
