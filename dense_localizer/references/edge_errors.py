"""How sure the place of a key sphere is among those around it: what all edges there say together.

An edge that one way alone has measured is wide. Where both its ends are known by other edges, the motion between them
is as sure as those make it: of the key spheres around one the information of all edges is added up and inverted. The
errors of edges add up along the graph: what is told is how far a key sphere is off all of them, not the next one alone.
"""

from __future__ import annotations

import numpy as np

from dense_localizer.constants import EDGE_HOPS
from sphere_nav.estimation.gates import gate
from sphere_nav.estimation.normal_equations import symmetric_inverse
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.graph import Edge, SphereGraph


class EdgeErrors:
    """Made of a graph; of each key sphere when it is first asked for."""

    def __init__(self, graph: SphereGraph) -> None:
        self._graph, self._found = graph, dict[int, Array | None]()
        self._edges: dict[int, list[Edge]] = {}
        for edge in graph.edges:
            for end in (edge.a, edge.b):
                self._edges.setdefault(end, []).append(edge)

    def covariance(self, sphere_id: int) -> Array | None:
        """Return the mean covariance (6, 6) of the motions to the key spheres around one, its own axes.

        One that another drive added later says how sure that one is: the map stayed where it was. None where there is
        no other.
        """
        if sphere_id not in self._found:
            self._found[sphere_id] = self._average(sphere_id)
        return self._found[sphere_id]

    def _average(self, sphere_id: int) -> Array | None:
        if sphere_id not in self._edges:
            return None
        own, motions = self._graph[sphere_id], relative_covariances(self._graph, self._edges, sphere_id)
        found = []
        for other in (self._graph[node] for node in motions):
            if other.id < sphere_id or other.experience == own.experience:
                R = np.kron(np.eye(2), own.T_map_sphere.rotation.T @ other.T_map_sphere.rotation)
                found.append(R @ motions[other.id] @ R.T)
        return np.mean(found, axis=0) if found else None


def relative_covariances(graph: SphereGraph, edges_of: dict[int, list[Edge]], sphere_id: int) -> dict[int, Array]:
    """Return by id the covariance (6, 6) of x in T_sphere_other exp(x) of those around a key sphere.

    By all edges among those that are reached over `EDGE_HOPS` edges, refuted loops and edges that say nothing left out.
    """
    local = newest = {sphere_id}
    for _ in range(EDGE_HOPS):
        reached = (edge for node in newest for edge in edges_of.get(node, ()) if is_usable(graph, edge))
        newest = {end for edge in reached for end in (edge.a, edge.b)} - local
        local = local | newest
    rows = {node: slice(6 * k, 6 * k + 6) for k, node in enumerate(sorted(local - {sphere_id}))}
    information = np.zeros((6 * len(rows), 6 * len(rows)))
    for node in sorted(local):
        for edge in edges_of.get(node, ()):
            if edge.a != node or edge.b not in local or not is_usable(graph, edge):
                continue
            ends = {edge.a: -edge.T_a_b.inverse().adjoint(), edge.b: np.eye(6)}  # of xi, by each end
            for one, J in ends.items():
                for other, K in ends.items():
                    if sphere_id not in (one, other):
                        information[rows[one], rows[other]] += J.T @ edge.information @ K
    covariance = symmetric_inverse(information)
    return {node: covariance[at, at] for node, at in rows.items()}


def is_usable(graph: SphereGraph, edge: Edge) -> bool:
    """Say whether an edge fixes a motion; a loop that the map contradicts, by where it has the ends, fixes none."""
    if np.any(np.linalg.eigvalsh(edge.information) <= 0.0):
        return False
    if not edge.is_loop:
        return True
    T_a_b = graph[edge.a].T_map_sphere.inverse() @ graph[edge.b].T_map_sphere
    xi = (edge.T_a_b.inverse() @ T_a_b).log()
    return bool(xi @ edge.information @ xi <= gate(6))
