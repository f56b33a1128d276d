"""Voxels with their planes, and their coarser copies."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.columns.voxel_map import voxel_map

SIZE = 0.1


def plane(normal, count=20_000, seed=1, sigma=0.0):
    """Return points around the origin on a plane of 3 m."""
    rng = np.random.default_rng(seed)
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    along = np.cross(normal, [0.3, 0.5, 0.8])
    along /= np.linalg.norm(along)
    u, v = rng.uniform(-1.5, 1.5, (2, count, 1))
    return u * along + v * np.cross(normal, along) + rng.normal(0.0, sigma + 1e-9, (count, 1)) * normal


@pytest.mark.parametrize("level", [0, 2])
def test_the_planes_of_a_plane_are_the_plane(level) -> None:
    for normal in [(0, 0, 1), (1, 2, 3)]:
        found = voxel_map(cloud_from_points(plane(normal, sigma=0.01)), SIZE, 3).levels[level]
        unit = np.array(normal) / np.linalg.norm(normal)
        normals = found.voxels[:, 5:]
        is_plane = np.linalg.norm(normals, axis=1) > 0.5
        assert is_plane.mean() > 0.95
        assert np.median(np.abs(normals[is_plane] @ unit)) > 0.99  # points are 1 cm off it, over 0.3 m


def test_gaps_are_closed_in_planes_only() -> None:
    points = plane((0, 0, 1), 60_000)
    hole = np.all(np.abs(points[:, :2] - 0.05) < 0.05, axis=1)
    closed = voxel_map(cloud_from_points(points[~hole]), SIZE, 1).levels[0]
    assert len(closed.cells) == len(voxel_map(cloud_from_points(points), SIZE, 1).levels[0].cells)
    two = np.concatenate([points, points + np.array([0.0, 0.0, 2 * SIZE])])  # two floors with one voxel between
    assert set(voxel_map(cloud_from_points(two), SIZE, 1).levels[0].cells[:, 2]) <= {0, 2, 3}
