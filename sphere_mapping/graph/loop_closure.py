"""Places seen twice: found by appearance, placed by features, verified by dense alignment both ways (M15 3.5.2).

A candidate's first pose comes from features matched with the older sphere's, so that it may be turned any way, as on
the way back or at a crossing. What places that look alike would suggest is refused by where the graph can be at all:
the way between the two spheres has drifted by some per cent, not by a house.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, MutableMapping
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sphere_mapping.constants import (
    DRIFT,
    DRIFT_START,
    MAX_AWAY,
    MIN_DETOUR,
    MIN_LEAD,
    NUM_OLDER,
    SAME_PLACE_M,
)
from sphere_mapping.graph.motion import Expectation
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.graph.verification import (
    Candidate,
    Lookup,
    Run,
    find_candidates,
    look_up,
    trial_of,
    verify,
    verify_all,
    verify_pairs,
)
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.appearance.features import Features, features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

Load = Callable[[int], Sphere]


Kept = MutableMapping[int, Features]  # what key spheres look like, by id


class LoopCloser:
    """Finds the loops of one growing graph; `load` returns key spheres by id, `index` holds what they look like."""

    def __init__(self, params: MapperParams, load: Load, features: Kept | None = None) -> None:
        self._params, self._load = params, load
        self.index = AppearanceIndex(features)

    def find(self, graph: SphereGraph, newer: PreparedSphere, newer_id: int) -> Edge | None:
        """Index a new key sphere; return the loop edge to the best older one, if any holds."""
        if newer_id not in self.index.features:
            self.index.add(newer_id, newer.features)
        chosen = choose_candidate(graph, newer_id, find_candidates(self._lookup(graph, newer_id)))
        return verify(trial_of(newer_id, newer.sphere, [chosen], self._load)) if chosen is not None else None

    def find_all(self, graph: SphereGraph, run: Run = map) -> list[Edge]:
        """Return every verified loop that the graph lacks, by appearance and of spheres that see the same."""
        self.index_all(graph)
        joined, ids = joined_pairs(graph), list(graph.nodes)
        placed = run(find_candidates, (self._lookup(graph, newer_id) for newer_id in ids))
        found = zip(ids, placed, strict=True)
        chosen = {newer_id: choose_candidate(graph, newer_id, candidates) for newer_id, candidates in found}
        asked = ((newer_id, [one]) for newer_id, one in chosen.items() if one)
        loops = verify_all(asked, self._load, self._load, run)
        joined |= {(loop.a, loop.b) for loop in loops}
        is_whole = bool(ids) and self._load(ids[0]).camera.is_whole
        seen = list(seen_pairs(graph, graph, joined, is_whole=is_whole))
        return loops + verify_pairs(seen, self._load, self._load, run)

    def recognize(self, graph: SphereGraph, current: PreparedSphere) -> Candidate | None:
        """Return the key sphere by which a sphere that is not in the graph is seen to be; None where several could."""
        found = find_candidates(look_up(self.index, current.features))
        return choose_clear(graph, found, lambda *_: SAME_PLACE_M)

    def prepare(self, sphere_id: int) -> PreparedSphere:
        """Return a key sphere to align with."""
        return PreparedSphere(self._load(sphere_id))

    def index_all(self, graph: SphereGraph) -> None:
        """Index what all key spheres look like."""
        for node in graph:
            if node.id not in self.index.features:
                self.index.add(node.id, features_of_sphere(self._load(node.id)))

    def _lookup(self, graph: SphereGraph, newer_id: int) -> Lookup:
        """Return the older spheres that look like one, neither on the way that led to it nor joined with it."""
        before = passed(graph, newer_id, self._params.loop.min_way_m)
        joined = [end for edge in graph.edges if newer_id in (edge.a, edge.b) for end in (edge.a, edge.b)]
        without = [newer_id, *before, *joined]
        found = look_up(self.index, self.index.features[newer_id], without)
        return replace(found, alike=tuple(one for one in found.alike if one[0] < newer_id))


def passed(graph: SphereGraph, newer_id: int, min_way_m: float) -> list[int]:
    """Return the key spheres that the way to one has passed and not come back to."""
    found, way = list[int](), 0.0
    here = at = graph[newer_id].T_map_sphere.translation
    for sphere_id in range(newer_id - 1, -1, -1):  # those of one drive follow each other
        if sphere_id not in graph.nodes:
            break
        there = graph[sphere_id].T_map_sphere.translation
        way, at = way + float(np.linalg.norm(there - at)), there
        if way < max(min_way_m, MIN_DETOUR * float(np.linalg.norm(there - here))):
            found.append(sphere_id)
    return found


def choose_candidate(graph: SphereGraph, newer_id: int, found: list[Candidate]) -> Candidate | None:
    """Return the best of the candidates that drift allows; None where another place has nearly as many features."""
    if not found:
        return None
    ways = lengths_from(graph, newer_id)
    possible = [one for one in found if is_possible(graph, newer_id, one, ways)]
    return choose_clear(graph, possible, lambda best, other: _spread(ways, best, other))


def choose_clear(
    graph: SphereGraph, found: list[Candidate], spread_m: Callable[[Candidate, Candidate], float]
) -> Candidate | None:
    """Return the candidate with the most features; None where one farther than the spread has nearly as many."""
    best = max(found, key=lambda one: one.num_inliers, default=None)
    if best is None:
        return None
    at = place_of(graph, best).translation
    rivals = [one for one in found if one.num_inliers * MIN_LEAD > best.num_inliers]
    is_clear = all(np.linalg.norm(place_of(graph, one).translation - at) <= spread_m(best, one) for one in rivals)
    return best if is_clear else None


def is_possible(graph: SphereGraph, newer_id: int, one: Candidate, ways: dict[int, float]) -> bool:
    """Say whether the graph can have drifted by as much as a candidate asks for."""
    return drifted(graph[newer_id].T_map_sphere, ways.get(one.older, np.inf)).allows(place_of(graph, one))


def drifted(T_map_sphere: SE3, way: float) -> Expectation:
    """Return where a key sphere may truly be, by what the graph drifts over so many metres of way."""
    return Expectation(T_map_sphere, DRIFT_START[0] + DRIFT[0] * way, DRIFT_START[1] + DRIFT[1] * way)


def place_of(graph: SphereGraph, one: Candidate) -> SE3:
    """Return where a candidate says that the new sphere is in the map."""
    return graph[one.older].T_map_sphere @ one.T_older_newer


def lengths_from(graph: SphereGraph, sphere_id: int) -> dict[int, float]:
    """Return the metres along edges from a key sphere to every other one that it is connected with."""
    edges, number = graph.edges, len(graph)
    if not edges:
        return {sphere_id: 0.0}
    row = {node_id: index for index, node_id in enumerate(graph.nodes)}
    pairs = np.array([row[edge.a] * number + row[edge.b] for edge in edges])
    pairs, first = np.unique(pairs, return_index=True)  # of several edges between two spheres one is enough
    meters = np.maximum([edge.length_m for edge in edges], 1e-6)[first]
    matrix = csr_array((meters, np.divmod(pairs, number)), shape=(number, number))
    found: Array = dijkstra(matrix, directed=False, indices=row[sphere_id])
    is_connected = np.isfinite(found)
    ids = np.fromiter(row, np.int64, number)[is_connected]
    return dict(zip(ids.tolist(), found[is_connected].tolist(), strict=True))


def joined_pairs(graph: SphereGraph) -> set[tuple[int, int]]:
    """Return the pairs (smaller id, larger id) that edges join."""
    return {(min(edge.a, edge.b), max(edge.a, edge.b)) for edge in graph.edges}


def seen_pairs(
    graph: SphereGraph, known: SphereGraph, joined: set[tuple[int, int]], *, is_whole: bool
) -> Iterator[tuple[KeySphere, KeySphere]]:
    """Yield pairs (older, newer) of `known` and `graph` that see the same and are not yet joined, few of each newer.

    Second and third neighbours among them: where each key sphere hangs on the one before it, errors add up.
    """
    reach_m = MAX_AWAY * max((node.region_radius_m or 1.0 for node in known), default=1.0)
    num_older = Counter(newer_id for _, newer_id in joined)
    for newer in graph:
        found = [
            (away(older.T_map_sphere.inverse() @ newer.T_map_sphere, older.region_radius_m or 1.0, is_whole), older.id)
            for older in known.near(newer.T_map_sphere.translation, reach_m)
            if older.id < newer.id and (older.id, newer.id) not in joined
        ]
        number = max(0, NUM_OLDER - num_older[newer.id])
        for apart, older_id in sorted(found)[:number]:
            if apart <= MAX_AWAY:
                yield known[older_id], newer


def away(T_a_b: SE3, reach_m: float, is_whole: bool) -> float:
    """Return how far apart two views are: by the reach of the one, and by a radian where they have an edge."""
    distance, angle = SE3.identity().distance(T_a_b)
    return float(distance) / reach_m + (0.0 if is_whole else float(angle))


def _spread(ways: dict[int, float], best: Candidate, other: Candidate) -> float:
    """Return how far apart two suggestions of one place may lie: the graph between their spheres has drifted, too."""
    return SAME_PLACE_M + DRIFT[0] * abs(ways.get(best.older, 0.0) - ways.get(other.older, 0.0))
