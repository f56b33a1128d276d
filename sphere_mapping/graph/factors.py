"""A pose graph as factors of GTSAM, and its least-squares problem solved by Levenberg-Marquardt."""

from __future__ import annotations

from typing import NamedTuple

import gtsam
import numpy as np

from sphere_mapping.constants import ANCHOR_SIGMA, DESCENT_TOLERANCE, MAX_STEPS, ROBUST_WIDTH
from sphere_mapping.graph.pose_graph import PoseGraph
from sphere_nav.geometry.arrays import Array

ANGLE_FIRST = [3, 4, 5, 0, 1, 2]  # our (v, omega) in GTSAM's order (omega, v)


class DescentResult(NamedTuple):
    """Where a descent ended: poses (N, 4, 4), the weighted sum of squares there, and its steps."""

    poses: Array
    chi2: float
    iterations: int


def factors_of(graph: PoseGraph) -> gtsam.NonlinearFactorGraph:
    """Return an edge's error as log(T_measured^-1 T_a^-1 T_b) with its full information matrix."""
    factors = gtsam.NonlinearFactorGraph()
    huber = gtsam.noiseModel.mEstimator.Huber.Create(ROBUST_WIDTH)
    ordered = np.ascontiguousarray(graph.information[:, ANGLE_FIRST][:, :, ANGLE_FIRST])
    for (a, b), motion, information, is_robust in zip(
        graph.ends.tolist(), graph.motions, ordered, graph.is_robust, strict=True
    ):
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Gaussian.Information(information)
        noise = gtsam.noiseModel.Robust.Create(huber, noise) if is_robust else noise
        factors.add(gtsam.BetweenFactorPose3(a, b, gtsam.Pose3(motion), noise))
    return factors


def chi2_of(factors: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> float:
    """Return the weighted sum of squares at some poses; GTSAM's error is half of it."""
    return float(2.0 * factors.error(values))


def minimize_poses(
    factors: gtsam.NonlinearFactorGraph, graph: PoseGraph, start: gtsam.Values | None = None
) -> DescentResult | None:
    """Return where Levenberg-Marquardt ends, None where it breaks down: from the chordal solution, or a given start."""
    anchored, settings = placed_factors(factors, graph), gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(MAX_STEPS["descent"])
    settings.setRelativeErrorTol(DESCENT_TOLERANCE)
    settings.setAbsoluteErrorTol(0.0)
    try:
        first = gtsam.InitializePose3.initialize(anchored) if start is None else start
        optimizer = gtsam.LevenbergMarquardtOptimizer(anchored, first, settings)
        values = optimizer.optimize()
    except RuntimeError:  # an indeterminate system: the start was hopeless
        return None
    found = np.array([values.atPose3(row).matrix() for row in range(len(graph.ids))])
    chi2 = chi2_of(factors, values)
    return DescentResult(found, chi2, int(optimizer.iterations())) if np.isfinite(chi2) else None


def placed_factors(factors: gtsam.NonlinearFactorGraph, graph: PoseGraph) -> gtsam.NonlinearFactorGraph:
    """Return the factors and those that hold the anchors where they are."""
    anchored = gtsam.NonlinearFactorGraph(factors)
    noise = gtsam.noiseModel.Isotropic.Sigma(6, ANCHOR_SIGMA)
    for row in graph.anchors:
        anchored.add(gtsam.PriorFactorPose3(int(row), gtsam.Pose3(graph.poses[row]), noise))
    return anchored


def values_of(graph: PoseGraph) -> gtsam.Values:
    """Return the poses of a graph as GTSAM has them."""
    values = gtsam.Values()
    for row, pose in enumerate(graph.poses):
        values.insert(row, gtsam.Pose3(pose))
    return values
