"""A pose graph as factors of GTSAM, and its least-squares problem solved by Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import gtsam
import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from sphere_mapping.constants import ANCHOR_SIGMA, BATCH_SOLVED, DESCENT_TOLERANCE, MAX_STEPS, ROBUST_WIDTH
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
    return float(2.0 * factors.error(_values(graph, poses)))


def edge_chi2(graph: PoseGraph, poses: Array) -> Array:
    """Return the weighted square (M,) of each edge at poses (N, d + 1, d + 1), robust kernels left aside."""
    factors = factors_of(replace(graph, is_robust=np.zeros(len(graph.ends), np.bool_)))
    values = _values(graph, poses)
    return np.array([2.0 * factors.at(k).error(values) for k in range(len(graph.ends))])


def innovations(kept: PoseGraph, tried: PoseGraph, poses: Array, limit: float = np.inf) -> Array:
    """Return by how much (K,) each edge tried would add to chi2 if it alone joined the kept ones at their optimum.

    r' (1 + J P J')^-1 r: r the edge's whitened error, J its derivative, P the joint covariance of its two poses. It is
    at least (r' r)^2 / (r' r + r' J P J' r) (Cauchy-Schwarz), which takes one solution of the sparse system instead of
    six; where that is above the limit already, it is returned.
    """
    values, size, count = _values(kept, poses), TANGENT_SIZE[kept.dimension], len(tried.ends)
    system = _anchored(factors_of(kept), kept, poses).linearize(values).sparseJacobian_()
    rows, columns = (index.astype(np.int64) - 1 for index in system[:2])
    A = coo_array((system[2], (rows, columns))).tocsc()[:, : size * len(kept.ids)]  # the last column is the error
    information = splu(
        csc_array(A.T @ A), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    edges = factors_of(tried).linearize(values)
    jacobians, errors = zip(*(edges.at(k).jacobian() for k in range(count)), strict=True) if count else ((), ())
    J, r = np.array(jacobians).reshape(count, size, 2 * size), np.array(errors).reshape(count, size)
    places = np.repeat(tried.ends * size, size, axis=1) + np.tile(np.arange(size), 2)  # (K, 2 p) unknowns of the ends
    square, found = np.sum(r * r, axis=1), np.empty(count)
    for first in range(0, count, BATCH_SOLVED):
        own = np.arange(first, min(first + BATCH_SOLVED, count))
        gradients, right = np.einsum("kij,ki->kj", J[own], r[own]), np.zeros((size * len(kept.ids), len(own)))
        right[places[own], np.arange(len(own))[:, None]] = gradients
        spread = np.einsum("kj,kj->k", gradients, information.solve(right)[places[own], np.arange(len(own))[:, None]])
        found[own] = square[own] ** 2 / np.maximum(square[own] + spread, np.finfo(float).tiny)
    for k in np.flatnonzero(found <= limit):
        right = np.zeros((size * len(kept.ids), size))
        right[places[k]] = J[k].T
        found[k] = r[k] @ np.linalg.solve(np.eye(size) + J[k] @ information.solve(right)[places[k]], r[k])
    return found


def minimize_poses(
    factors: gtsam.NonlinearFactorGraph, graph: PoseGraph, poses: Array, max_steps: int = MAX_STEPS["descent"]
) -> DescentResult | None:
    """Return where Levenberg-Marquardt ends from these poses, None where it breaks down."""
    kind, anchored = KINDS[graph.dimension], _anchored(factors, graph, poses)
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(max_steps)
    settings.setRelativeErrorTol(DESCENT_TOLERANCE)
    settings.setAbsoluteErrorTol(0.0)
    try:
        optimizer = gtsam.LevenbergMarquardtOptimizer(anchored, _values(graph, poses), settings)
        values = optimizer.optimize()
    except RuntimeError:  # an indeterminate system: the start was hopeless
        return None
    found = np.array([kind.at(values, row).matrix() for row in range(len(poses))])
    chi2 = float(2.0 * factors.error(values))
    return DescentResult(found, chi2, int(optimizer.iterations())) if np.isfinite(chi2) else None


def _anchored(factors: gtsam.NonlinearFactorGraph, graph: PoseGraph, poses: Array) -> gtsam.NonlinearFactorGraph:
    kind, size = KINDS[graph.dimension], TANGENT_SIZE[graph.dimension]
    anchored = gtsam.NonlinearFactorGraph(factors)
    noise = gtsam.noiseModel.Isotropic.Sigma(size, ANCHOR_SIGMA)
    for row in graph.anchors:
        anchored.add(kind.prior(int(row), kind.pose(poses[row]), noise))
    return anchored


def _values(graph: PoseGraph, poses: Array) -> gtsam.Values:
    values, kind = gtsam.Values(), KINDS[graph.dimension]
    for row, pose in enumerate(poses):
        values.insert(row, kind.pose(pose))
    return values
