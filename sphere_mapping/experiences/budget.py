"""What a map that holds too much goes without: first bytes of its key spheres, then what explained least.

A key sphere is condensed before any leaves (`spheres/condensed.py`); those go first, either way, that explain the
fewest images of a drive in their light. The only one of a place never leaves.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from sphere_mapping.graph.merging import drop
from sphere_nav.spheres.experiences import find_places
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph

CountBytes = Callable[[int, bool], float]  # of a key sphere by its id, as it is and condensed


@dataclass(frozen=True)
class Budget:
    """How many experiences a place may hold, or how many bytes the key spheres of a map may take; 0: any."""

    num_experiences: int = 0
    num_bytes: float = 0.0

    @staticmethod
    def parse(text: str) -> Budget:
        """Return the budget of `3`, `200MB` or `17.5MB`; ValueError for anything else."""
        number = r"[1-9][0-9]{0,6}"
        found = re.fullmatch(rf"({number})|({number}(?:\.[0-9]{{1,3}})?)MB", text.strip())
        if found is None:
            raise ValueError(f"expected experiences a place, as 3, or megabytes, as 200MB, found {text[:40]!r}")
        return Budget(int(found[1])) if found[1] else Budget(num_bytes=1e6 * float(found[2]))


@dataclass(frozen=True, eq=False)
class Thinned:
    """A graph within a budget, how many key spheres left it, and the ids of those of it that are to be condensed."""

    graph: SphereGraph
    num_left: int = 0
    condensed: set[int] = field(default_factory=set)


def thin(graph: SphereGraph, budget: Budget, count_bytes: CountBytes, *, is_whole: bool) -> Thinned:
    """Return the graph within a budget, as far as places keep one key sphere each; the least serving ones go first.

    `is_whole`: its spheres see in every direction.
    """
    sizes, condensed = _condense(graph, budget, count_bytes) if budget.num_bytes else ({}, set())
    left, leaving, total = graph, list[int](), sum(sizes.values())
    while True:
        most = budget.num_experiences or (1 if total > budget.num_bytes else len(graph))
        places = find_places(left, is_whole=is_whole) if most < len(graph) else {}
        crowded = [left[node_id] for node_id, found in places.items() if len(found) > most]
        least = [node for node in crowded if _is_least(node, places[node.id])]
        if not least:
            return Thinned(drop(graph, leaving).graph, len(leaving), condensed - set(leaving))
        gone = min(least, key=_service)
        leaving.append(gone.id)
        total -= sizes.get(gone.id, 0.0)
        left = SphereGraph(node for node in left if node.id != gone.id)


def _condense(graph: SphereGraph, budget: Budget, count_bytes: CountBytes) -> tuple[dict[int, float], set[int]]:
    """Return the bytes of key spheres by id, and which of them are condensed: as many as it needs, or all."""
    sizes, condensed = {node.id: count_bytes(node.id, False) for node in graph}, set[int]()
    total = sum(sizes.values())
    for node in sorted(graph, key=_service):
        if total <= budget.num_bytes:
            break
        size = count_bytes(node.id, True)
        if size < sizes[node.id]:
            total, sizes[node.id] = total + size - sizes[node.id], size
            condensed.add(node.id)
    return sizes, condensed


def _service(node: KeySphere) -> tuple[float, int]:
    return node.served, node.id


def _is_least(node: KeySphere, found: dict[Experience, float]) -> bool:
    """Say whether no other experience at the place of a key sphere served less than its own."""
    return found[node.experience] <= min(found.values())
