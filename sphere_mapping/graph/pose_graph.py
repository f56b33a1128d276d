"""Poses joined by measured motions, as arrays: what is optimized, as a map has them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.graph import SphereGraph


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """N poses and M motions between them.

    ids: (N,) names of the poses.
    poses: (N, 4, 4) T_map_i, where an optimization starts.
    ends: (M, 2) rows a, b of the poses that an edge joins.
    motions: (M, 4, 4) T_a_b as measured.
    information: (M, 6, 6) of xi in T_a_b exp(xi), xi = (v, omega).
    is_robust: (M,) edges that lose weight where they fit badly.
    """

    ids: NDArray[np.int64]
    poses: Array
    ends: NDArray[np.int64]
    motions: Array
    information: Array
    is_robust: NDArray[np.bool_]

    @cached_property
    def anchors(self) -> NDArray[np.int64]:
        """Rows (C,) of the poses that stay where they are: the first one of every connected part."""
        a, b = self.ends.T
        joined = coo_array((np.ones(len(a)), (a, b)), shape=(len(self.ids), len(self.ids)))
        _, parts = connected_components(joined, directed=False)
        return np.unique(parts, return_index=True)[1].astype(np.int64)


def from_spheres(graph: SphereGraph) -> PoseGraph:
    """Return the key spheres and edges of a map as arrays; loop edges are robust."""
    row = {node.id: k for k, node in enumerate(graph)}
    edges = graph.edges
    return PoseGraph(
        np.array(list(row), dtype=np.int64),
        np.array([node.T_map_sphere.matrix for node in graph]),
        np.array([(row[edge.a], row[edge.b]) for edge in edges], dtype=np.int64),
        np.array([edge.T_a_b.matrix for edge in edges]),
        np.array([edge.information for edge in edges]),
        np.array([edge.is_loop for edge in edges]),
    )


def to_spheres(graph: SphereGraph, poses: Array) -> SphereGraph:
    """Return the map with its key spheres at other poses (N, 4, 4), in the graph's order."""
    matrices = SE3.from_matrix(poses)
    return graph.with_poses({node.id: matrices[k] for k, node in enumerate(graph)})
