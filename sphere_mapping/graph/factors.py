"""A pose graph as factors of GTSAM, and its least-squares problem solved by Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import gtsam
import numpy as np

from sphere_mapping.constants import ANCHOR_SIGMA, DESCENT_TOLERANCE, MAX_STEPS, ROBUST_WIDTH
from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph
from sphere_nav.geometry.arrays import Array

ANGLE_FIRST = [3, 4, 5, 0, 1, 2]  # our (v, omega) in GTSAM's order of space (omega, v); in the plane they agree


class DescentResult(NamedTuple):
    """Where a descent ended: poses (N, d + 1, d + 1), the weighted sum of squares there, and its steps."""

    poses: Array
    chi2: float
    iterations: int


class Kind(NamedTuple):
    """GTSAM's classes for the plane or for space."""

    pose: Callable[..., Any]
    at: Callable[[gtsam.Values, int], Any]
    prior: Callable[..., Any]
    between: Callable[..., Any]


KINDS = {
    2: Kind(
        lambda T: gtsam.Pose2(T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])),
        gtsam.Values.atPose2,
        gtsam.PriorFactorPose2,
        gtsam.BetweenFactorPose2,
    ),
    3: Kind(
        gtsam.Pose3,
        gtsam.Values.atPose3,
        gtsam.PriorFactorPose3,
        gtsam.BetweenFactorPose3,
    ),
}


def factors_of(graph: PoseGraph) -> gtsam.NonlinearFactorGraph:
    """Return an edge's error as log(T_measured^-1 T_a^-1 T_b) with its full information matrix."""
    kind, factors = KINDS[graph.dimension], gtsam.NonlinearFactorGraph()
    order = ANGLE_FIRST if graph.dimension == 3 else [0, 1, 2]
    huber = gtsam.noiseModel.mEstimator.Huber.Create(ROBUST_WIDTH)
    ordered = np.ascontiguousarray(graph.information[:, order][:, :, order])
    for (a, b), motion, information, is_robust in zip(
        graph.ends.tolist(), graph.motions, ordered, graph.is_robust, strict=True
    ):
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Gaussian.Information(information)
        noise = gtsam.noiseModel.Robust.Create(huber, noise) if is_robust else noise
        factors.add(kind.between(a, b, kind.pose(motion), noise))
    return factors


def chi2_of(factors: gtsam.NonlinearFactorGraph, graph: PoseGraph, poses: Array) -> float:
    """Return the weighted sum of squares at some poses; GTSAM's error is half of it."""
    return float(2.0 * factors.error(values_of(graph, poses)))


def minimize_poses(
    factors: gtsam.NonlinearFactorGraph, graph: PoseGraph, poses: Array, max_steps: int = MAX_STEPS["descent"]
) -> DescentResult | None:
    """Return where Levenberg-Marquardt ends from these poses, None where it breaks down."""
    kind, anchored = KINDS[graph.dimension], placed_factors(factors, graph, poses)
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(max_steps)
    settings.setRelativeErrorTol(DESCENT_TOLERANCE)
    settings.setAbsoluteErrorTol(0.0)
    try:
        optimizer = gtsam.LevenbergMarquardtOptimizer(anchored, values_of(graph, poses), settings)
        values = optimizer.optimize()
    except RuntimeError:  # an indeterminate system: the start was hopeless
        return None
    found = np.array([kind.at(values, row).matrix() for row in range(len(poses))])
    chi2 = float(2.0 * factors.error(values))
    return DescentResult(found, chi2, int(optimizer.iterations())) if np.isfinite(chi2) else None


def placed_factors(factors: gtsam.NonlinearFactorGraph, graph: PoseGraph, poses: Array) -> gtsam.NonlinearFactorGraph:
    """Return the factors and those that hold the anchors where they are."""
    kind, size = KINDS[graph.dimension], TANGENT_SIZE[graph.dimension]
    anchored = gtsam.NonlinearFactorGraph(factors)
    noise = gtsam.noiseModel.Isotropic.Sigma(size, ANCHOR_SIGMA)
    for row in graph.anchors:
        anchored.add(kind.prior(int(row), kind.pose(poses[row]), noise))
    return anchored


def values_of(graph: PoseGraph, poses: Array) -> gtsam.Values:
    """Return the poses as GTSAM has them."""
    values, kind = gtsam.Values(), KINDS[graph.dimension]
    for row, pose in enumerate(poses):
        values.insert(row, kind.pose(pose))
    return values
