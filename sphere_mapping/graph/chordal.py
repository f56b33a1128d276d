"""The linear side of a pose graph: starts of an optimization that need no guess.

With X = (R_1 t_1 ... R_N t_N) the chordal cost, the sum of kappa |R_b - R_a R_ab|^2 + tau |t_b - t_a - R_a t_ab|^2 over
all edges, is the quadratic form tr(X M X^T). What makes it hard is only that each R_i must be a rotation.
Carlone et al., Initialization Techniques for 3D SLAM (ICRA 2015); Rosen et al., SE-Sync (IJRR 2019).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from sphere_mapping.graph.pose_graph import PoseGraph
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.so3 import nearest_rotations


def quadratic_form(graph: PoseGraph) -> csc_array:
    """Return M ((d + 1) N, (d + 1) N), symmetric and at least 0; entries of a pose are its d axes, then its origin."""
    size, (a, b) = graph.dimension + 1, graph.ends.T
    kappa, tau = graph.precisions
    D = np.zeros((len(a), size, size))
    D[:, range(size), range(size)] = np.column_stack([*[kappa] * graph.dimension, tau])
    TD = graph.motions @ D
    blocks = [(b, b, D), (a, a, TD @ np.swapaxes(graph.motions, 1, 2)), (a, b, -TD), (b, a, -np.swapaxes(TD, 1, 2))]
    return of_blocks(blocks, len(graph.ids), size)


def chordal_poses(graph: PoseGraph) -> Array:
    """Return poses (N, d + 1, d + 1): rotations as if any matrix were one, made rotations, then the best origins."""
    d, count = graph.dimension, len(graph.ids)
    M = quadratic_form(graph)
    is_axis = np.tile(np.arange(d + 1) < d, count)
    is_anchored = np.repeat(np.isin(np.arange(count), graph.anchors), d + 1)
    X = np.zeros((d, count * (d + 1)))
    X[:, is_anchored] = np.hstack(list(graph.poses[graph.anchors, :d]))
    rotation_only = _rotation_form(graph)
    X[:, is_axis] = _complete(rotation_only, X[:, is_axis], is_anchored[is_axis])
    axes = X[:, is_axis].reshape(d, count, d).swapaxes(0, 1)
    X[:, is_axis] = nearest_rotations(axes).swapaxes(0, 1).reshape(d, -1)
    return as_poses(_complete(M, X, is_axis | is_anchored), d)


def as_poses(X: Array, d: int) -> Array:
    """Return the poses (N, d + 1, d + 1) of X (d, (d + 1) N)."""
    poses = np.tile(np.eye(d + 1), (X.shape[1] // (d + 1), 1, 1))
    poses[:, :d] = X.reshape(d, -1, d + 1).swapaxes(0, 1)
    return poses


def _rotation_form(graph: PoseGraph) -> csc_array:
    """Return the part (d N, d N) of the quadratic form that speaks of rotations alone."""
    d, (a, b) = graph.dimension, graph.ends.T
    weights = graph.precisions[0][:, None, None]
    R = graph.motions[:, :d, :d]
    unit = weights * np.broadcast_to(np.eye(d), R.shape)
    blocks = [(b, b, unit), (a, a, unit), (a, b, -weights * R), (b, a, -weights * np.swapaxes(R, 1, 2))]
    return of_blocks(blocks, len(graph.ids), d)


def of_blocks(blocks: list[tuple[NDArray[np.int64], NDArray[np.int64], Array]], count: int, size: int) -> csc_array:
    """Return the sum of blocks (K, size, size) at rows and columns (K,) of `count` each."""
    within = np.arange(size)
    rows, columns, data = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    i = np.broadcast_to(rows[:, None, None] * size + within[:, None], data.shape)
    j = np.broadcast_to(columns[:, None, None] * size + within, data.shape)
    return csc_array(coo_array((data.ravel(), (i.ravel(), j.ravel())), shape=(count * size, count * size)))


def _complete(M: csc_array, X: Array, is_known: NDArray[np.bool_]) -> Array:
    """Return X (d, K) with the unknown columns such that tr(X M X^T) is smallest."""
    known, unknown = np.flatnonzero(is_known), np.flatnonzero(~is_known)
    if unknown.size == 0:
        return X
    right = -(M[unknown][:, known] @ X[:, known].T)
    solver = splu(csc_array(M[unknown][:, unknown]), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    completed = X.copy()
    completed[:, unknown] = solver.solve(right).T
    return completed
