"""Two spheres by their ranges alone: point to plane ICP, a second opinion that knows nothing of images."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.sphere import Sphere

STEP, FARTHEST_M = 2, 6.0  # every second row and column; beyond, structured light is too coarse
NUM_POINTS, NUM_NEIGHBOURS = 20_000, 20
LIMITS_M, NUM_ITERATIONS = (0.5, 0.2, 0.1, 0.05), 15  # of pairs, from coarse to fine; of each
NOISE_M = 0.02  # beyond which a pair counts less


def icp(a: Sphere, b: Sphere, T_a_b: SE3) -> SE3:
    """Return T_a_b by the surfaces of both spheres, from a first guess."""
    target, source = (_cloud(sphere) for sphere in (a, b))
    tree = cKDTree(target)
    normals = _normals(target, tree)
    chosen = source[np.random.default_rng(0).permutation(len(source))[:NUM_POINTS]]
    for limit in LIMITS_M:
        for _ in range(NUM_ITERATIONS):
            step = _step(T_a_b.apply(chosen), target, normals, tree, limit)
            T_a_b = SE3.exp(step) @ T_a_b
            if np.linalg.norm(step) < 1e-6:
                break
    return T_a_b


def _step(points: Array, target: Array, normals: Array, tree: cKDTree, limit: float) -> Array:
    """Return the motion (6,) that brings points nearest to the planes of their neighbours."""
    distance, index = tree.query(points, distance_upper_bound=limit)
    is_paired = np.isfinite(distance)
    points, index = points[is_paired], index[is_paired]
    n = normals[index]
    residual = np.einsum("ni,ni->n", points - target[index], n)
    weight = 1.0 / np.maximum(np.abs(residual) / NOISE_M, 1.0)
    J = np.hstack([n, np.cross(points, n)])
    return -np.linalg.solve((J * weight[:, None]).T @ J, (J * weight[:, None]).T @ residual)


def _cloud(sphere: Sphere) -> Array:
    points = sphere.points(STEP)[0].astype(np.float64)
    return points[np.linalg.norm(points, axis=1) < FARTHEST_M]


def _normals(points: Array, tree: cKDTree) -> Array:
    """Return the normal (N, 3) of the plane through the neighbours of each point."""
    near = points[tree.query(points, k=NUM_NEIGHBOURS)[1]]
    off = near - near.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))[1][..., 0])
