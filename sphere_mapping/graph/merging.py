"""Key spheres of positions that were seen twice: one is enough for the map (M15 section 3.5.2).

A key sphere leaves the map where edges join it with one of another visit that stays, and where everything it was
nearest to is near enough to spheres that stay: by the regions in which these localize, and by the spacing of the drive.
What was measured to it is composed, so that the graph keeps what it knows. Spheres that follow each other on one visit
do not replace each other: how far apart those are was decided when they were kept.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from scipy.spatial import cKDTree

from sphere_mapping.constants import MERGE_REACH, MERGE_SPACING, MIN_DETOUR
from sphere_nav.estimation.least_squares import symmetric, symmetric_inverse
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph


def merge(
    graph: SphereGraph, positions: Array, staying: Collection[int] = (), unlike: Collection[int] = ()
) -> SphereGraph:
    """Return the graph without redundant key spheres; of those that see the same the newest leaves.

    positions (P, 3): where in the map all spheres were taken, those that were not kept, too. staying: ids that stay.
    unlike: ids of those that look like no other experience; only spheres of their own replace them.
    """
    merger = _Merger(graph, np.concatenate([positions.reshape(-1, 3), _positions(graph)]))
    for node in sorted(graph, key=lambda node: -node.id):
        if node.id not in staying:
            merger.try_without(node, is_unlike=node.id in unlike)
    return merger.result()


def drop(graph: SphereGraph, ids: Collection[int]) -> SphereGraph:
    """Return the graph without some key spheres, their edges composed to the one that each was measured best from."""
    merger = _Merger(graph, _positions(graph))
    for node_id in ids:
        merger.drop(node_id)
    return merger.result()


def compose_edges(first: Edge, second: Edge) -> Edge:
    """Return the edge a -> c of a -> b and b -> c: the product, its covariance carried by the adjoint.

    T_a_b exp(x) T_b_c exp(y) = T_a_b T_b_c exp(Ad(T_c_b) x + y), to first order.
    """
    adjoint = second.T_a_b.inverse().adjoint()
    covariance = adjoint @ np.linalg.inv(first.information) @ adjoint.T + np.linalg.inv(second.information)
    is_loop = first.is_loop or second.is_loop
    return Edge(first.a, second.b, first.T_a_b @ second.T_a_b, symmetric_inverse(covariance), is_loop)


def reverse(edge: Edge) -> Edge:
    """Return the same motion from the other end: (T exp(x))^-1 = T^-1 exp(-Ad(T) x)."""
    adjoint = edge.T_a_b.inverse().adjoint()
    return Edge(edge.b, edge.a, edge.T_a_b.inverse(), symmetric(adjoint.T @ edge.information @ adjoint), edge.is_loop)


class _Merger:
    """The graph while spheres leave it: its edges, and the positions that each sphere is nearest to."""

    def __init__(self, graph: SphereGraph, points: Array) -> None:
        self._left = set[int]()
        self._graph, self._points, self._edges = graph, points, list(graph.edges)
        self._farthest = MERGE_REACH * max((node.region_radius_m for node in graph), default=0.0)
        self._along, self._spacing = _along(graph), _spacing(graph)
        nearest = cKDTree(_positions(graph)).query(points)[1]
        self._served = {node.id: np.flatnonzero(nearest == row).tolist() for row, node in enumerate(graph)}

    def try_without(self, node: KeySphere, *, is_unlike: bool = False) -> None:
        """Let a key sphere leave if others serve what it serves; an unlike one, if others of its experience do."""
        hubs = [edge for edge in self._edges_from(node.id) if self._is_again(node.id, edge.b)]
        if not hubs:
            return
        servers = [self._server(self._points[point], node, is_unlike) for point in self._served[node.id]]
        if any(server is None for server in servers):
            return
        self._leave(node.id, min(hubs, key=_variance))
        for point, server in zip(self._served.pop(node.id), servers, strict=True):
            assert server is not None
            self._served[server].append(point)

    def drop(self, node_id: int) -> None:
        """Let a key sphere leave, whatever it serves; one without edges just leaves."""
        edges = self._edges_from(node_id)
        if edges:
            self._leave(node_id, min(edges, key=_variance))
        self._left.add(node_id)

    def _leave(self, node_id: int, hub: Edge) -> None:
        """Compose the edges of a key sphere with the one to a hub, which takes its place."""
        edges, back = self._edges_from(node_id), reverse(hub)
        self._edges = [edge for edge in self._edges if node_id not in (edge.a, edge.b)]
        self._edges += [compose_edges(back, edge) for edge in edges if edge.b != hub.b]
        self._left.add(node_id)

    def result(self) -> SphereGraph:
        """Return what is left, edges in order."""
        if not self._left:
            return self._graph
        kept = [node for node in self._graph if node.id not in self._left]
        return SphereGraph(
            kept, sorted(self._edges, key=lambda one: (max(one.a, one.b), min(one.a, one.b), one.is_loop))
        )

    def _edges_from(self, node_id: int) -> list[Edge]:
        """Return the edges of a key sphere as they begin there."""
        own = (edge for edge in self._edges if node_id in (edge.a, edge.b))
        return [edge if edge.a == node_id else reverse(edge) for edge in own]

    def _is_again(self, one: int, other: int) -> bool:
        """Say whether two key spheres are of one place that the way came back to, or of two drives."""
        (drive, at), (other_drive, other_at) = self._along[one], self._along[other]
        distance, _ = self._graph[one].T_map_sphere.distance(self._graph[other].T_map_sphere)
        return drive != other_drive or abs(at - other_at) >= MIN_DETOUR * float(distance)

    def _server(self, point: Array, leaving: KeySphere, is_unlike: bool) -> int | None:
        """Return the nearest key sphere whose region reaches a point well, None where there is none near enough."""
        reach = min(self._farthest, MERGE_SPACING * self._spacing[leaving.id])
        near = [
            (float(np.linalg.norm(node.T_map_sphere.translation - point)), node)
            for node in self._graph.near(point, reach)
            if node.id != leaving.id and node.id not in self._left
            if not is_unlike or node.experience == leaving.experience
        ]
        reaching = [(distance, node.id) for distance, node in near if distance <= MERGE_REACH * node.region_radius_m]
        return min(reaching)[1] if reaching else None


def _along(graph: SphereGraph) -> dict[int, tuple[int, float]]:
    """Return for each key sphere the number of its drive, and the metres from its beginning."""
    chain = {(edge.a, edge.b): edge for edge in graph.edges if not edge.is_loop}
    found: dict[int, tuple[int, float]] = {}
    before, drive, meters = -1, -1, 0.0
    for node_id in sorted(graph.nodes):
        edge = chain.get((before, node_id))
        drive, meters = (drive, meters + edge.length_m) if edge is not None else (drive + 1, 0.0)
        found[node_id], before = (drive, meters), node_id
    return found


def _spacing(graph: SphereGraph) -> dict[int, float]:
    """Return how far each key sphere is from those before and after it, the farther one."""
    found = dict.fromkeys(graph.nodes, 0.0)
    for edge in graph.edges:
        for end in (edge.a, edge.b) if not edge.is_loop else ():
            found[end] = max(found[end], edge.length_m)
    return found


def _variance(edge: Edge) -> float:
    return float(np.trace(np.linalg.inv(edge.information)[:3, :3]))


def _positions(graph: SphereGraph) -> Array:
    return np.array([node.T_map_sphere.translation for node in graph]).reshape(-1, 3)
