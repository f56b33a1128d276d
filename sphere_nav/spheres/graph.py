"""The map: key spheres at poses, joined by measured motions (M15 eq. 10)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Integers
from sphere_nav.spheres.sphere import Sphere


@dataclass(frozen=True)
class Experience:
    """A drive that gave key spheres to a map; `name` is what the user calls its light, `stamp_ns` the first instant."""

    name: str = ""
    camera: str = ""
    drive: str = ""
    stamp_ns: int = 0

    def __str__(self) -> str:
        return self.name or self.drive or "the first drive"


@dataclass(frozen=True, eq=False)
class KeySphere:
    """A vertex: where a sphere was taken. `sphere` is None where only the pose is in memory.

    region_radius_m: up to where a camera can be localised by it; 0 where that is not known.
    served: images that it explains of a drive in its light, a mean of the last ones; last_served_ns: 0 for none.
    """

    id: int
    stamp_ns: int
    T_map_sphere: SE3
    sphere: Sphere | None = None
    region_radius_m: float = 0.0
    experience: Experience = Experience()
    served: float = 0.0
    last_served_ns: int = 0


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured motion between two vertices; information (6, 6) is that of xi in T_a_b @ exp(xi), xi = (v, omega)."""

    a: int
    b: int
    T_a_b: SE3
    information: Array
    is_loop: bool = False

    def __post_init__(self) -> None:
        if self.information.shape != (6, 6) or not np.all(np.isfinite(self.information)):
            raise ValueError(
                f"edge {self.a}-{self.b} information: expected finite 6 x 6, found {self.information.shape}"
            )

    @cached_property
    def length_m(self) -> float:
        """Metres between its ends, as measured."""
        return float(np.linalg.norm(self.T_a_b.translation))


class SphereGraph:
    """Key spheres in order of insertion, and edges between them."""

    def __init__(self, nodes: Iterable[KeySphere] = (), edges: Iterable[Edge] = ()) -> None:
        self._nodes: dict[int, KeySphere] = {}
        self._edges: list[Edge] = []
        self._index: tuple[Array, Integers] | None = None  # positions and ids
        for node in nodes:
            self.add(node)
        for edge in edges:
            self.connect(edge)

    @property
    def nodes(self) -> Mapping[int, KeySphere]:
        """The key spheres by id."""
        return self._nodes

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The edges in order of insertion."""
        return tuple(self._edges)

    def __len__(self) -> int:
        return len(self._nodes)

    def __iter__(self) -> Iterator[KeySphere]:
        return iter(self._nodes.values())

    def __getitem__(self, node_id: int) -> KeySphere:
        if node_id not in self._nodes:
            raise ValueError(f"key sphere: expected one of {len(self)} in the graph, found {node_id}")
        return self._nodes[node_id]

    def add(self, node: KeySphere) -> None:
        """Add a key sphere; ValueError if its id is taken or its pose not finite."""
        if node.id in self._nodes:
            raise ValueError(f"key sphere: expected a new id, found {node.id} again")
        self._put(node)

    def forget_sphere(self, node_id: int) -> None:
        """Drop the picture of a key sphere from memory; its pose stays."""
        self._nodes[node_id] = replace(self[node_id], sphere=None)

    def connect(self, edge: Edge) -> None:
        """Add an edge; ValueError unless both ends are in the graph and differ."""
        if edge.a == edge.b:
            raise ValueError(f"edge: expected two key spheres, found {edge.a} twice")
        for end in (edge.a, edge.b):
            if end not in self._nodes:
                raise ValueError(f"edge {edge.a}-{edge.b}: expected both ends in the graph, found no {end}")
        self._edges.append(edge)

    def nearest(self, point: ArrayLike, count: int = 1, max_distance_m: float = np.inf) -> list[KeySphere]:
        """Return up to `count` key spheres by distance (eq. 17) from a point (3,) of the map, equal ones by id."""
        if not self._nodes:
            return []
        distances, ids = self._distances(point)
        if distances.size > count:  # those at the same distance as the last one, too
            max_distance_m = min(max_distance_m, float(np.partition(distances, count - 1)[count - 1]))
        rows = np.flatnonzero(distances <= max_distance_m)
        nearest = rows[np.argsort(distances[rows], kind="stable")][:count]
        return [self._nodes[one] for one in ids[nearest].tolist()]

    def near(self, point: ArrayLike, distance_m: float) -> list[KeySphere]:
        """Return all key spheres within a distance of a point (3,) of the map, by id."""
        if not self._nodes:
            return []
        distances, ids = self._distances(point)
        return [self._nodes[node_id] for node_id in ids[distances <= distance_m].tolist()]

    def with_poses(self, poses: Mapping[int, SE3]) -> SphereGraph:
        """Return the same graph with other poses T_map_sphere of some key spheres; the others cost next to nothing."""
        return self.with_nodes({node_id: {"T_map_sphere": pose} for node_id, pose in poses.items()})

    def with_nodes(self, changes: Mapping[int, Mapping[str, Any]]) -> SphereGraph:
        """Return the same graph with other fields of some key spheres, by id."""
        graph = self._copy()
        for node_id, fields in changes.items():
            graph._put(replace(self[node_id], **fields))
        return graph

    def with_edges(self, edges: Iterable[Edge]) -> SphereGraph:
        """Return the same graph with more edges; ValueError as `connect`."""
        graph = self._copy()
        for edge in edges:
            graph.connect(edge)
        return graph

    def _copy(self) -> SphereGraph:
        graph = SphereGraph()
        graph._nodes, graph._edges = dict(self._nodes), list(self._edges)
        return graph

    def _put(self, node: KeySphere) -> None:
        """Add a key sphere, or put it in the place of the one with its id."""
        if not np.all(np.isfinite(node.T_map_sphere.matrix)):
            raise ValueError(f"key sphere {node.id} pose: expected finite numbers, found {node.T_map_sphere.matrix}")
        self._nodes[node.id] = node
        self._index = None

    def _distances(self, point: ArrayLike) -> tuple[Array, Integers]:
        """Return the distance of every key sphere from a point (3,), and the ids in their order."""
        if self._index is None:
            ids = np.array(sorted(self._nodes), dtype=np.int64)
            self._index = np.array([self._nodes[one].T_map_sphere.translation for one in ids.tolist()]), ids
        positions, ids = self._index
        apart = positions - np.asarray(point, dtype=np.float64)
        return np.sqrt(np.einsum("ij,ij->i", apart, apart)), ids
