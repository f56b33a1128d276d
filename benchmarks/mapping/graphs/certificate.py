"""The best optimum of a pose graph, and whether a better one can exist (Rosen et al., SE-Sync, IJRR 2019)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csc_array, eye_array, kron
from scipy.sparse.linalg import SuperLU, splu

from sphere_mapping.constants import COST_TOLERANCE
from sphere_mapping.graph.chordal import chordal_poses, of_blocks, quadratic_form
from sphere_mapping.graph.factors import chi2_of, factors_of, minimize_poses
from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph
from sphere_nav.geometry import so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.so3 import nearest_rotations

CERTIFICATE_TOLERANCE = 1e-3  # share of the cost by which a better optimum might be missed
DAMPING, MAX_STEPS = (1e-6, 1e6), 50  # first and last one, share of the mean curvature; of Newton
GENERATORS = {2: np.array([[[0.0, -1.0], [1.0, 0.0]]]), 3: so3.hat(np.eye(3))}  # of rotations, (G, d, d)


class ChordalOptimum(NamedTuple):
    """Where the chordal cost is smallest nearby: poses (N, d + 1, d + 1), the cost, and whether none is lower."""

    poses: Array
    cost: float
    is_global: bool


@dataclass(frozen=True, eq=False)
class Certified:
    """Poses (N, d + 1, d + 1) that fit best, chi2 before and there; the chordal cost nearby, and if none is lower."""

    poses: Array
    chi2_before: float
    chi2_after: float
    cost: float
    is_global: bool


def optimize(graph: PoseGraph) -> Certified:
    """Return the best optimum found and its certificate; ValueError where every descent broke down.

    The certificate is one of the chordal cost with isotropic precisions, not of chi2 itself: from its optimum a last
    descent leads to the optimum of chi2 next to it.
    """
    factors = factors_of(graph)
    first = chordal_poses(graph)
    chordal = minimize_poses(factors, graph, first)
    certificate = certify(graph, first if chordal is None else chordal.poses)
    ends = [chordal, minimize_poses(factors, graph, certificate.poses)]
    if not certificate.is_global and (given := minimize_poses(factors, graph, graph.poses)) is not None:
        ends.append(given)
        certificate = min(certificate, certify(graph, given.poses), key=lambda it: (not it.is_global, it.cost))
    found = [end for end in ends if end is not None]
    if not found:
        raise ValueError("pose graph: expected edges that determine all poses, found a system without a solution")
    best = min(found, key=lambda end: end.chi2)
    before = chi2_of(factors, graph, graph.poses)
    return Certified(best.poses, before, best.chi2, certificate.cost, certificate.is_global)


def certify(graph: PoseGraph, poses: Array, tolerance: float = CERTIFICATE_TOLERANCE) -> ChordalOptimum:
    """Return the optimum of the chordal cost near some poses, and whether it is the global one.

    `is_global`: no poses at all have a cost below (1 - tolerance) times this one. Newton's method with the exact
    Hessian: the certificate needs a gradient of zero, and Gauss-Newton is slow where residuals are large.
    """
    M = quadratic_form(graph)
    K = kron(M, eye_array(graph.dimension), format="csr")
    is_free = np.repeat(~np.isin(np.arange(len(graph.ids)), graph.anchors), TANGENT_SIZE[graph.dimension])
    (damping, last), cost = DAMPING, _cost(M, poses)
    for _ in range(MAX_STEPS):
        H, g, scale = _expansion(M, K, poses, is_free)
        lower = None
        while lower is None and damping < last:
            lower = _step(M, H, g, damping * scale, poses, is_free, cost)
            damping *= 10.0 if lower is None else 0.1
        if lower is None:
            break
        previous, (poses, cost) = cost, lower
        if previous - cost <= COST_TOLERANCE * cost:
            break
    return ChordalOptimum(poses, cost, _is_global(M, poses, graph, tolerance))


def as_rows(poses: Array) -> Array:
    """Return X (d, (d + 1) N) of poses (N, d + 1, d + 1)."""
    d = poses.shape[-1] - 1
    return poses[:, :d].swapaxes(0, 1).reshape(d, -1)


def _cost(M: csc_array, poses: Array) -> float:
    X = as_rows(poses)
    return float(np.sum((X @ M) * X))


def _multipliers(M: csc_array, poses: Array) -> Array:
    """Return Lambda (N, d, d), symmetric: at an optimum X (M - Lambda) = 0."""
    d, size = poses.shape[-1] - 1, poses.shape[-1]
    XM = (as_rows(poses) @ M).reshape(d, -1, size).swapaxes(0, 1)
    products = np.swapaxes(poses[:, :d, :d], 1, 2) @ XM[:, :, :d]
    return (products + np.swapaxes(products, 1, 2)) / 2


def _expansion(M: csc_array, K: csc_array, poses: Array, is_free: NDArray[np.bool_]) -> tuple[csc_array, Array, float]:
    """Return Hessian and gradient, halved, by (omega, v) of the free poses, and the mean curvature.

    A rotation moves to R (I + hat(omega)), made a rotation again, an origin by v along the axes of the map.
    """
    count, d, E = len(poses), poses.shape[-1] - 1, GENERATORS[poses.shape[-1] - 1]
    B = np.zeros((count, d + 1, d, len(E) + d))  # column of a pose, row, parameter
    B[:, :d, :, : len(E)] = np.einsum("nij,gjk->nkig", poses[:, :d, :d], E)
    B[:, d, :, len(E) :] = np.eye(d)
    by_pose = bsr_array((B.reshape(count, (d + 1) * d, -1), np.arange(count), np.arange(count + 1))).tocsr()
    bending = np.zeros((count, len(E) + d, len(E) + d))
    bending[:, : len(E), : len(E)] = np.einsum("nij,gjk,hki->ngh", _multipliers(M, poses), E, E)
    bending = (bending + np.swapaxes(bending, 1, 2)) / 2
    curvature = (by_pose.T @ K @ by_pose).tocsc()
    rows = np.arange(count)
    H = csc_array(curvature + of_blocks([(rows, rows, bending)], count, len(E) + d))
    g = by_pose.T @ (as_rows(poses) @ M).T.ravel()
    free = np.flatnonzero(is_free)
    return csc_array(H[free][:, free]), g[free], float(curvature.diagonal().mean())


def _step(
    M: csc_array, H: csc_array, g: Array, damping: float, poses: Array, is_free: NDArray[np.bool_], cost: float
) -> tuple[Array, float] | None:
    """Return poses and cost after a damped step, None where that is not lower."""
    factors = _factorise(csc_array(H + damping * eye_array(H.shape[0])))
    if factors is None:
        return None
    d, E = poses.shape[-1] - 1, GENERATORS[poses.shape[-1] - 1]
    step = np.zeros(is_free.size)
    step[is_free] = -factors.solve(g)
    omega, v = np.split(step.reshape(len(poses), -1), [len(E)], axis=1)
    found = poses.copy()
    found[:, :d, :d] = nearest_rotations(poses[:, :d, :d] @ (np.eye(d) + np.einsum("ng,gij->nij", omega, E)))
    found[:, :d, d] += v
    lower = _cost(M, found)
    return (found, lower) if lower < cost else None


def _is_global(M: csc_array, poses: Array, graph: PoseGraph, tolerance: float) -> bool:
    """Whether the dual bound reaches (1 - tolerance) times the cost of a stationary point.

    For symmetric Lambda_i with M - Lambda at least 0 the sum of tr Lambda_i bounds the cost from below. Those of the
    stationary point, whose traces add up to its cost, are lowered by what the tolerance allows.
    """
    d, count, size = graph.dimension, len(poses), graph.dimension + 1
    multipliers = _multipliers(M, poses)
    bound = float(np.trace(multipliers, axis1=1, axis2=2).sum())
    lowering = (bound - (1.0 - tolerance) * _cost(M, poses)) / (d * count)
    if lowering <= 0:
        return False
    Lambda = np.zeros((count, size, size))
    Lambda[:, :d, :d] = multipliers - lowering * np.eye(d)
    rows = np.arange(count)
    S = M - of_blocks([(rows, rows, Lambda)], count, size)
    is_kept = np.ones(count * size, dtype=np.bool_)
    is_kept[graph.anchors * size + d] = False  # a common shift of a connected part costs nothing
    kept = np.flatnonzero(is_kept)
    return _factorise(csc_array(S[kept][:, kept])) is not None


def _factorise(S: csc_array) -> SuperLU | None:
    """Return the factors of a symmetric sparse matrix, None unless all pivots are on its diagonal and above 0.

    SciPy has no sparse Cholesky; without pivoting LU has its pattern, and the pivots' signs are those of LDL^T.
    """
    try:
        factors = splu(S, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # exactly singular
        return None
    is_positive = np.array_equal(factors.perm_r, factors.perm_c) and np.all(factors.U.diagonal() > 0)
    return factors if is_positive else None
