"""The best optimum of a pose graph that can be found, and whether a better one can exist."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from benchmarks.mapping.graphs.certificate import ChordalOptimum, certify
from sphere_mapping.graph.chordal import chordal_poses
from sphere_mapping.graph.factors import chi2_of, factors_of, minimize_poses, placed_factors, values_of
from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph
from sphere_nav.geometry.arrays import Array

BATCH_SOLVED = 50  # right sides at once: those of 10,000 poses take 24 MB


@dataclass(frozen=True, eq=False)
class Certified:
    """Poses (N, d + 1, d + 1) that fit best, chi2 before and there, and the certificate of the chordal cost nearby."""

    poses: Array
    chi2_before: float
    chi2_after: float
    certificate: ChordalOptimum


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
    return Certified(best.poses, chi2_of(factors, graph, graph.poses), best.chi2, certificate)


def edge_chi2(graph: PoseGraph, poses: Array) -> Array:
    """Return the weighted square (M,) of each edge at poses (N, d + 1, d + 1), robust kernels left aside."""
    factors = factors_of(replace(graph, is_robust=np.zeros(len(graph.ends), np.bool_)))
    values = values_of(graph, poses)
    return np.array([2.0 * factors.at(k).error(values) for k in range(len(graph.ends))])


def innovations(kept: PoseGraph, tried: PoseGraph, poses: Array, limit: float = np.inf) -> Array:
    """Return by how much (K,) each edge tried would add to chi2 if it alone joined the kept ones at their optimum.

    r' (1 + J P J')^-1 r: r the edge's whitened error, J its derivative, P the joint covariance of its two poses. It is
    at least (r' r)^2 / (r' r + r' J P J' r) (Cauchy-Schwarz), which takes one solution of the sparse system instead of
    six; where that is above the limit already, it is returned.
    """
    values, size, count = values_of(kept, poses), TANGENT_SIZE[kept.dimension], len(tried.ends)
    system = placed_factors(factors_of(kept), kept, poses).linearize(values).sparseJacobian_()
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
