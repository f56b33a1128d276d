"""A growing graph kept at its optimum by what is new to it: iSAM2 (Kaess et al., IJRR 2012), by GTSAM.

A loop moves what lies between its ends; the cost follows that, not the size of the map. Small graphs are optimised
whole, from two starts, which costs less than keeping them.
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np

from sphere_geometry import SE3
from sphere_map.graph import Edge, SphereGraph
from sphere_mapping.graph.factors import ANCHOR_SIGMA, factors_of
from sphere_mapping.graph.loop_closure import with_loops
from sphere_mapping.graph.pose_graph import PoseGraph

LARGE = 300  # key spheres from which on it pays
RELINEARIZE = 0.003  # m and rad by which a pose moves before it is linearised anew
NUM_STEPS = 4  # of Gauss-Newton after a loop


class IncrementalOptimum:
    """Takes note of a graph as it grows, in order of its edges."""

    def __init__(self) -> None:
        settings = gtsam.ISAM2Params()
        settings.setRelinearizeThreshold(RELINEARIZE)
        settings.relinearizeSkip = 1
        self._solver = gtsam.ISAM2(settings)
        self._known: set[int] = set()
        self._num_edges = 0

    @property
    def is_used(self) -> bool:
        """Whether it has corrected a graph by itself."""
        return bool(self._known)

    def with_loop(self, graph: SphereGraph, loop: Edge) -> SphereGraph:
        """Return the graph with a loop edge added, at the poses that fit all edges best."""
        if len(graph) < LARGE:
            return with_loops(graph, [loop])
        grown = SphereGraph(graph, [*graph.edges, loop])
        fresh = [node for node in grown if node.id not in self._known]
        values = gtsam.Values()
        for node in fresh:
            values.insert(node.id, gtsam.Pose3(node.T_map_sphere.matrix))
        factors = factors_of(as_arrays(grown, grown.edges[self._num_edges :]))
        if not self._known:
            noise = gtsam.noiseModel.Isotropic.Sigma(6, ANCHOR_SIGMA)
            factors.add(gtsam.PriorFactorPose3(fresh[0].id, gtsam.Pose3(fresh[0].T_map_sphere.matrix), noise))
        self._solver.update(factors, values)
        for _ in range(NUM_STEPS - 1):
            self._solver.update()
        self._known |= {node.id for node in fresh}
        self._num_edges = len(grown.edges)
        found = self._solver.calculateEstimate()
        poses = SE3.from_matrix(np.array([found.atPose3(node_id).matrix() for node_id in grown.nodes]))
        return grown.with_poses({node_id: poses[k] for k, node_id in enumerate(grown.nodes)})


def as_arrays(graph: SphereGraph, edges: Sequence[Edge]) -> PoseGraph:
    """Return some edges of a graph, their ends by the ids of the key spheres."""
    return PoseGraph(
        np.array(list(graph.nodes), dtype=np.int64),
        np.array([node.T_map_sphere.matrix for node in graph]),
        np.array([(edge.a, edge.b) for edge in edges], dtype=np.int64),
        np.array([edge.T_a_b.matrix for edge in edges]),
        np.array([edge.information for edge in edges]),
        np.array([edge.is_loop for edge in edges]),
    )
