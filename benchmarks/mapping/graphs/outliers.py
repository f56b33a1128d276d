"""READ FIRST: the poses that fit what the true loops measured, and which loops are false.

A loop is an edge between poses that do not follow one another; edges between neighbors are odometry and are believed.
(1) Loops that close a short cycle with one another and with odometry support each other; a false one finds no such
neighbor, whatever the drift is. (2) Graduated non-convexity with truncated least squares (Yang et al., RA-L 2020), each
step solved by GTSAM, finds the core of those that are supported. (3) Loops are admitted that fit the result, and
those that it can bend to within its own covariance and that are supported as well as nearly all kept ones, until
nothing changes; of several that are bent to together those go again that do not fit then. How far is too far follows
from the residuals themselves: information matrices of published graphs are off by factors of up to 20,000. So
all this is done with the mean variances of each edge; only the last optimum is that of the matrices themselves. GTSAM's
own GncOptimizer begins each step at the first poses again, at one limit: here a step begins where the last one ended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from scipy.special import chdtri

from benchmarks.mapping.graphs.certificate import Certified, optimize
from sphere_mapping.constants import MAX_STEPS
from sphere_mapping.graph.chordal import chordal_poses
from sphere_mapping.graph.factors import factors_of, minimize_poses, placed_factors, values_of
from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph
from sphere_nav.geometry.arrays import Array

LOOP_WINDOW = 10  # poses between the ends of two loops that may support each other: their odometry is good
ALIKE_QUANTILE = 0.2  # of the cycles' errors: of a true loop as long as a fifth of all loops is true and supported
SUPPORT_RATIO = 3.0  # of that error: supported, as 70 to 85 % of true loops and up to 8 % of false ones
BATCH = 100  # loops at a time of which is found whether the kept ones can bend to them
BENT_QUANTILE = 0.99  # of the support of kept loops (300 and more), beyond which nothing is bent to another one
CORE_RATIO = 4.0  # of the median chi2: the core, from which the limit of true loops follows
FEW_LOOPS = 20  # below which their residuals say nothing about their scale
RIGHT_REJECTED = 1e-9  # share of true loops beyond the limit if they were Gaussian
TAIL_DECADES = 2.0  # in which chi2 may grow as from its 90 to its 99 %: to one loop in 10,000; true ones up to 1.5
GNC_GROWTH, GNC_ROUNDS = 1.8, 100  # of mu in each round (Yang et al.: 1.4, from first poses); rounds at most
ADMISSION_ROUNDS = 50
GNC_STEPS = 4  # of a descent in each round

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RobustOptimum:
    """The optimum of the edges that were kept, and what became of the others.

    optimum: poses and chi2 of the kept edges alone. is_outlier: (M,) edges judged false.
    """

    optimum: Certified
    is_outlier: Mask


def optimize_robustly(graph: PoseGraph) -> RobustOptimum:
    """Return the optimum without the loops that contradict the others; ValueError where every descent broke down."""
    is_loop = loops_of(graph)
    searched = _isotropic(graph)
    support = cycle_support(searched, is_loop)
    is_tried = _supported(is_loop, support)
    start = chordal_poses(graph_of_edges(searched, ~is_loop | is_tried))
    is_kept, poses = _graduate(searched, ~is_loop, is_tried, start)
    is_kept = _admit(searched, is_loop, is_kept, support, poses)
    return RobustOptimum(optimize(graph_of_edges(graph, is_kept)), ~is_kept)


def edge_chi2(graph: PoseGraph, poses: Array) -> Array:
    """Return the weighted square (M,) of each edge at poses (N, d + 1, d + 1), robust kernels left aside."""
    factors = factors_of(replace(graph, is_robust=np.zeros(len(graph.ends), np.bool_)))
    values = values_of(graph, poses)
    return np.array([2.0 * factors.at(k).error(values) for k in range(len(graph.ends))])


def loops_of(graph: PoseGraph) -> Mask:
    """Return which edges (M,) are loops: those between poses that are not neighbors in the order of their ids."""
    is_loop: Mask = np.abs(np.diff(graph.ends, axis=1)[:, 0]) != 1
    return is_loop


def graph_of_edges(graph: PoseGraph, is_kept: Mask | NDArray[np.int64], weights: Array | None = None) -> PoseGraph:
    """Return the graph with some of its edges, by mask (M,) or rows, their information times the weights (M,)."""
    information = graph.information if weights is None else graph.information * weights[:, None, None]
    return replace(
        graph,
        ends=graph.ends[is_kept],
        motions=graph.motions[is_kept],
        information=information[is_kept],
        is_robust=graph.is_robust[is_kept],
    )


def cycle_support(graph: PoseGraph, is_loop: Mask) -> Array:
    """Return (M,) the smallest squared error, over its variance, of a cycle with another loop; inf without one.

    The cycle goes along one loop, LOOP_WINDOW poses of odometry at most, back along the other one, and home. Variances
    are the isotropic ones of rotation and translation, that of rotation with the cycle's length as its lever.
    """
    poses, part, variance = _dead_reckoning(graph, is_loop)
    loops, found = np.flatnonzero(is_loop), np.full(len(graph.ends), np.inf)
    is_back = graph.ends[loops, 0] > graph.ends[loops, 1]
    ends = np.sort(graph.ends[loops], axis=1)
    motions = np.where(is_back[:, None, None], np.linalg.inv(graph.motions[loops]), graph.motions[loops])
    if len(loops) < 2:
        return found
    i, j = cKDTree(ends).query_pairs(LOOP_WINDOW, p=np.inf, output_type="ndarray").T
    (i, j) = (pairs[np.all(part[ends[i]] == part[ends[j]], axis=1)] for pairs in (i, j))
    (a, b), (c, d), size = ends[i].T, ends[j].T, graph.dimension
    there, back = np.linalg.inv(poses[a]) @ poses[c], np.linalg.inv(poses[d]) @ poses[b]
    error = np.linalg.inv(motions[i]) @ there @ motions[j] @ back
    cosine = (np.trace(error[:, :size, :size], axis1=1, axis2=2) - (size - 2)) / 2
    turn2 = np.arccos(np.clip(cosine, -1, 1)) ** 2
    shift2 = np.sum(error[:, :size, size] ** 2, axis=1)
    length = sum(np.linalg.norm(part_way[:, :size, size], axis=1) for part_way in (there, motions[j], back))
    per_loop = 1 / np.stack(graph.precisions, axis=1)[loops]
    v = per_loop[i] + per_loop[j] + np.abs(variance[a] - variance[c]) + np.abs(variance[b] - variance[d])
    ratio = np.maximum(turn2 / v[:, 0], shift2 / (v[:, 1] + v[:, 0] * length**2))
    for side in (i, j):
        np.minimum.at(found, loops[side], ratio)
    return found


def _dead_reckoning(graph: PoseGraph, is_loop: Mask) -> tuple[Array, NDArray[np.int64], Array]:
    """Return poses chained along odometry, the unbroken part (N,) each is of, and sums of variances (N, 2)."""
    count, size = len(graph.ids), graph.dimension + 1
    steps, variance, is_joined = np.tile(np.eye(size), (count, 1, 1)), np.zeros((count, 2)), np.zeros(count, np.bool_)
    per_edge = 1 / np.stack(graph.precisions, axis=1)
    for k in np.flatnonzero(~is_loop)[::-1]:  # of several edges between two poses the first one of the file
        a, b = graph.ends[k]
        steps[max(a, b)] = graph.motions[k] if a < b else np.linalg.inv(graph.motions[k])
        variance[max(a, b)], is_joined[max(a, b)] = per_edge[k], True
    for row in np.flatnonzero(is_joined):
        steps[row] = steps[row - 1] @ steps[row]
    return steps, np.cumsum(~is_joined), np.cumsum(variance, axis=0)


def _supported(is_loop: Mask, support: Array) -> Mask:
    """Return which edges (M,) are loops that are supported as well as the best fifth of all loops, or nearly."""
    if not is_loop.any():
        return is_loop
    limit = SUPPORT_RATIO * float(np.quantile(support[is_loop], ALIKE_QUANTILE, method="lower"))
    found: Mask = is_loop & (support <= limit) & np.isfinite(support)
    return found


def _isotropic(graph: PoseGraph) -> PoseGraph:
    """Return the graph with the mean variances of translation and of rotation of each edge alone.

    A matrix that claims a thousand times more in one direction makes a true loop look false while the poses are still
    off by a centimeter.
    """
    (kappa, tau), size = graph.precisions, graph.dimension
    turns = kappa if size == 2 else 2 * kappa
    diagonal = np.repeat(np.stack([tau, turns], axis=1), (size, TANGENT_SIZE[size] - size), axis=1)
    return replace(graph, information=diagonal[:, :, None] * np.eye(TANGENT_SIZE[size]))


def _admit(graph: PoseGraph, is_loop: Mask, is_kept: Mask, support: Array, poses: Array) -> Mask:
    """Return the kept edges (M,) after all loops were admitted that fit, or that the kept ones can bend to."""
    seen: set[bytes] = set()
    has_bent, limit = False, np.inf
    for _ in range(ADMISSION_ROUNDS):
        chi2 = edge_chi2(graph, poses)
        is_beyond = is_kept & is_loop & (chi2 > limit)
        if has_bent and is_beyond.any():  # each alone could be bent to, all together cannot
            is_kept = is_kept & ~is_beyond
        else:
            limit = _too_far(graph, chi2[is_kept & is_loop])
            has_bent, is_kept = False, ~is_loop | (chi2 <= limit)
        if is_kept.tobytes() in seen:
            usual = np.quantile(np.append(support[is_kept & is_loop], [np.inf] * 3), BENT_QUANTILE, method="lower")
            others = np.flatnonzero(is_loop & ~is_kept & (support <= usual))
            others = others[np.argsort(chi2[others])][:BATCH]
            added = _innovations(graph_of_edges(graph, is_kept), graph_of_edges(graph, others), poses)
            is_tried = is_kept.copy()
            is_tried[others[added <= limit]] = True
            if is_tried.tobytes() in seen:
                break
            is_kept, has_bent = is_tried, True
        seen.add(is_kept.tobytes())
        poses = _solve(graph, is_kept, None, poses, chordal_poses(graph_of_edges(graph, is_kept)))
    return is_kept


def _innovations(kept: PoseGraph, tried: PoseGraph, poses: Array) -> Array:
    """Return by how much (K,) each edge tried would add to chi2 if it alone joined the kept ones at their optimum.

    r' (1 + J P J')^-1 r: r the edge's whitened error, J its derivative, P the joint covariance of its two poses.
    """
    values, size = values_of(kept, poses), TANGENT_SIZE[kept.dimension]
    system = placed_factors(factors_of(kept), kept, poses).linearize(values).sparseJacobian_()
    rows, columns = (index.astype(np.int64) - 1 for index in system[:2])
    A = coo_array((system[2], (rows, columns))).tocsc()[:, : size * len(kept.ids)]  # the last column is the error
    ways: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    information, edges = splu(csc_array(A.T @ A), **ways), factors_of(tried).linearize(values)
    found = np.empty(len(tried.ends))
    for k, ends in enumerate(tried.ends):
        J, r = edges.at(k).jacobian()
        place = np.add.outer(ends * size, np.arange(size)).ravel()
        right = np.zeros((size * len(kept.ids), size))
        right[place] = J.T
        found[k] = r @ np.linalg.solve(np.eye(size) + J @ information.solve(right)[place], r)
    return found


def _graduate(graph: PoseGraph, is_believed: Mask, is_tried: Mask, poses: Array) -> tuple[Mask, Array]:
    """Return which edges (M,) fit together and their poses: all believed ones, and of those tried the core, by GNC."""
    is_used = is_believed | is_tried
    poses = _solve(graph, is_used, None, poses)
    chi2 = edge_chi2(graph, poses)
    bound = CORE_RATIO * float(np.median(chi2[is_tried])) if is_tried.any() else np.inf
    worst = float(chi2[is_tried].max(initial=0.0))
    if worst <= bound:
        return is_used, poses
    mu, is_kept = bound / (2 * worst - bound), is_used
    for _ in range(GNC_ROUNDS):
        weights = np.sqrt(bound * mu * (mu + 1) / np.maximum(chi2, np.finfo(float).tiny)) - mu
        weights = np.where(is_believed, 1.0, np.clip(weights, 0.0, 1.0) * is_tried)
        poses = _solve(graph, weights > 0, weights, poses, max_steps=GNC_STEPS)
        chi2, is_kept = edge_chi2(graph, poses), weights >= 0.5
        if np.all((weights == 0) | (weights == 1)):
            break
        mu *= GNC_GROWTH
    return is_kept, _solve(graph, is_kept, None, poses)


def _too_far(graph: PoseGraph, chi2: Array) -> float:
    """Return the chi2 that no true loop has, by those (K,) of loops that are believed.

    Few: that of a Gaussian error as large as the information says. Many: that of a Gaussian of their median, or, with
    heavier tails, what chi2 reaches in two decades more if it goes on to grow as from its 90 to its 99 %.
    """
    size = TANGENT_SIZE[graph.dimension]
    if len(chi2) < FEW_LOOPS:
        return float(chdtri(size, RIGHT_REJECTED))
    middle, ninety, last = np.maximum(np.quantile(chi2, [0.5, 0.9, 0.99]), np.finfo(float).tiny)
    gaussian_middle, gaussian_limit = chdtri(size, [0.5, RIGHT_REJECTED])
    return float(max(middle * gaussian_limit / gaussian_middle, last * (last / ninety) ** TAIL_DECADES))


def _solve(
    graph: PoseGraph, is_used: Mask, weights: Array | None, *starts: Array, max_steps: int = MAX_STEPS["descent"]
) -> Array:
    used = graph_of_edges(graph, is_used, weights)
    ends = [minimize_poses(factors_of(used), used, poses, max_steps) for poses in starts]
    found = [end for end in ends if end is not None]
    if not found:
        raise ValueError("pose graph: expected edges that determine all poses, found a system without a solution")
    return min(found, key=lambda end: end.chi2).poses
