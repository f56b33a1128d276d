"""A growing graph kept at its optimum by what is new to it: iSAM2 (Kaess et al., IJRR 2012), by GTSAM.

A loop moves what lies between its ends; the cost follows that, not the size of the map. Small graphs are optimized
whole, from two starts, which costs less than keeping them.
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np

from sphere_mapping.constants import LARGE, LOOP_STEPS, RELINEARIZE
from sphere_mapping.graph.optimum import factors_of, hold, optimize_map, values_of
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph


class IncrementalOptimum:
    """Takes note of one graph as it grows: to what it returned last, key spheres and edges are added, no more."""

    def __init__(self) -> None:
        settings = gtsam.ISAM2Params()
        settings.setRelinearizeThreshold(RELINEARIZE)
        settings.relinearizeSkip = 1
        self._solver = gtsam.ISAM2(settings)
        self._row: dict[int, int] = {}  # of a key sphere, which is its name in the solver
        self._poses = np.empty((0, 12))  # rotation by rows and translation of each row, as they were returned last
        self._num_edges = 0

    @property
    def is_used(self) -> bool:
        """Whether it has corrected a graph by itself."""
        return bool(self._row)

    def with_loop(self, graph: SphereGraph, loop: Edge) -> SphereGraph:
        """Return the graph with a loop edge added, at the poses that fit all edges best."""
        grown = graph.with_edges([loop])
        if len(graph) < LARGE:
            return optimize_map(grown)
        self._solve(list(grown)[len(self._row) :], grown.edges[self._num_edges :])
        return grown.with_poses(self._moved())

    def _solve(self, nodes: Sequence[KeySphere], edges: Sequence[Edge]) -> None:
        """Take note of what is new, and go on, by Gauss-Newton, until nothing moves."""
        anchors = [] if self._row else nodes[:1]
        for node in nodes:
            self._row[node.id] = len(self._row)
        factors = factors_of(edges, self._row)
        hold(factors, anchors, self._row)
        self._num_edges += len(edges)
        self._solver.update(factors, values_of(nodes, self._row))
        for _ in range(LOOP_STEPS):
            if not self._solver.update().getVariablesRelinearized():
                break

    def _moved(self) -> dict[int, SE3]:
        """Return the poses T_map_sphere that are not what they were when they were returned last."""
        found = gtsam.utilities.extractPose3(self._solver.calculateEstimate())
        is_moved = np.ones(len(found), bool)
        is_moved[: len(self._poses)] = np.any(found[: len(self._poses)] != self._poses, axis=1)
        self._poses, rows = found, np.flatnonzero(is_moved)
        if not rows.size:
            return {}
        poses = SE3.from_parts(found[rows, :9].reshape(-1, 3, 3), found[rows, 9:]).orthonormal()
        ids = np.array(list(self._row))[rows]
        return {int(node_id): poses[k] for k, node_id in enumerate(ids)}
