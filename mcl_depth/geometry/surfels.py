"""Dense points as surfaces: a triangle in the plane of each voxel, as wide as the voxels around leave no gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mcl_depth.constants import INDEX_BITS, INRADIUS, NEAR_VOXELS, NUM_NEIGHBORS
from mcl_depth.geometry.cloud import Geometry, cube_keys

Floats = NDArray[np.float64]

BATCH = 1 << 18  # voxels whose neighbours are held at once
CORNERS = np.radians([90.0, 210.0, 330.0])


def surfels_of(cloud: Geometry, size: float) -> tuple[Geometry, float]:
    """Return a triangle for each voxel of `size` m, and the share of voxels whose neighbours are a surface.

    ValueError where a cloud is too wide for such voxels.
    """
    means = means_of(cloud.points.astype(np.float64), size, cloud.name)
    tree, count = cKDTree(means), min(NUM_NEIGHBORS, len(means))
    vertices, num_dense = np.empty((len(means), 3, 3), np.float32), 0
    for first in range(0, len(means), BATCH):
        own = means[first : first + BATCH]
        apart, rows = tree.query(own, k=count)
        around = means[rows.reshape(len(own), count)]
        around = around - around.mean(axis=1, keepdims=True)
        axes = np.linalg.eigh(np.swapaxes(around, 1, 2) @ around)[1]  # the normal first
        num_dense += int(np.count_nonzero(apart.reshape(len(own), count)[:, count // 2] < NEAR_VOXELS * size))
        for corner, angle in enumerate(CORNERS):
            reach = 2.0 * INRADIUS * size * np.array([np.cos(angle), np.sin(angle)])
            vertices[first : first + BATCH, corner] = own + axes[:, :, 2] * reach[0] + axes[:, :, 1] * reach[1]
    triangles = np.arange(3 * len(means), dtype=np.int32).reshape(-1, 3)
    return Geometry(vertices.reshape(-1, 3), cloud.name, triangles=triangles), num_dense / len(means)


def means_of(points: Floats, size: float, name: str) -> Floats:
    """Return the mean point (N, 3) of each voxel; ValueError where points are too wide for such voxels."""
    low = points.min(axis=0)
    if (extent := float((points - low).max())) / size >= 2**INDEX_BITS:
        raise ValueError(f"{name}: expected an extent below {2**INDEX_BITS * size:g} m, found {extent:g} m")
    _, voxel, counts = np.unique(cube_keys(points, low, size), return_inverse=True, return_counts=True)
    return np.stack([np.bincount(voxel, axis) for axis in points.T], axis=1) / counts[:, None]
