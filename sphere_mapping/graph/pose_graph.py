"""Correction of all poses so that every measured motion fits as well as it can (M15 section 3.5.2), by GTSAM."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3
from sphere_map.graph import Edge, SphereGraph

ANGLE_FIRST = [3, 4, 5, 0, 1, 2]  # our (v, omega) in GTSAM's order (omega, v)
ANCHOR_SIGMA = 1e-6  # the first pose stays where it is
ROBUST_WIDTH = 2.0  # standard deviations beyond which a loop edge loses weight (Huber)


@dataclass(frozen=True, eq=False)
class Optimized:
    """The corrected graph, and half the weighted sum of squares before and after."""

    graph: SphereGraph
    error_before: float
    error_after: float


def optimize(graph: SphereGraph, max_iterations: int = 100) -> Optimized:
    """Return the graph at the poses that fit its edges best; the first key sphere stays, loop edges are robust."""
    if not graph.edges:
        return Optimized(graph, 0.0, 0.0)
    factors, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for node in graph:
        start.insert(node.id, _pose3(node.T_map_sphere))
    first = next(iter(graph))
    anchor = gtsam.noiseModel.Isotropic.Sigma(6, ANCHOR_SIGMA)
    factors.add(gtsam.PriorFactorPose3(first.id, _pose3(first.T_map_sphere), anchor))
    for edge in graph.edges:
        factors.add(gtsam.BetweenFactorPose3(edge.a, edge.b, _pose3(edge.T_a_b), _noise(edge)))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(max_iterations)
    optimizer = gtsam.LevenbergMarquardtOptimizer(factors, start, settings)
    result = optimizer.optimize()
    poses = {node.id: SE3.from_matrix(result.atPose3(node.id).matrix()) for node in graph}
    return Optimized(graph.with_poses(poses), factors.error(start), factors.error(result))


def _noise(edge: Edge) -> gtsam.noiseModel.Base:
    noise = gtsam.noiseModel.Gaussian.Information(_angle_first(edge.information))
    if not edge.is_loop:
        return noise
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(ROBUST_WIDTH), noise)


def _angle_first(information: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.ascontiguousarray(information[np.ix_(ANGLE_FIRST, ANGLE_FIRST)])


def _pose3(T: SE3) -> gtsam.Pose3:
    return gtsam.Pose3(T.matrix)
