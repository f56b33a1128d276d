"""Pose graphs made from a seed: places on a sphere or a torus, joined along rows and columns by noisy motions."""

from __future__ import annotations

import numpy as np

from sphere_mapping.graph.pose_graph import PoseGraph
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array

SPHERE_M, TORUS_M = 50.0, (30.0, 12.0)  # radii


def sphere(rows: int, columns: int, sigmas: tuple[float, float], seed: int) -> PoseGraph:
    """Return a drive around a sphere in `rows` circles, each place joined to the one of the circle before."""
    elevation = np.linspace(-1.3, 1.3, rows * columns)  # climbs all the time
    azimuth = 2 * np.pi * np.arange(rows * columns) / columns
    ring = np.cos(elevation)
    outwards = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), np.sin(elevation)], axis=1)
    return _of_drive(_facing(outwards, SPHERE_M * outwards), columns, sigmas, seed)


def torus(rows: int, columns: int, sigmas: tuple[float, float], seed: int) -> PoseGraph:
    """Return a drive around a torus in `rows` circles, each place joined to the one of the circle before."""
    count = rows * columns
    around, along = 2 * np.pi * np.arange(count) / columns, 2 * np.pi * np.arange(count) / count
    axis = np.stack([np.cos(along), np.sin(along), np.zeros(count)], axis=1)
    outwards = np.cos(around)[:, None] * axis + np.sin(around)[:, None] * (0.0, 0.0, 1.0)
    return _of_drive(_facing(outwards, TORUS_M[0] * axis + TORUS_M[1] * outwards), columns, sigmas, seed)


def _facing(outwards: Array, positions: Array) -> SE3:
    """Return poses (N, 4, 4) whose x axis follows the drive and whose z axis looks outwards."""
    along = np.gradient(positions, axis=0)
    along -= np.sum(along * outwards, axis=1, keepdims=True) * outwards
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return SE3.from_parts(np.stack([along, np.cross(outwards, along), outwards], axis=2), positions)


def _of_drive(truth: SE3, columns: int, sigmas: tuple[float, float], seed: int) -> PoseGraph:
    """Return the graph whose poses are the chained odometry; sigmas: m and rad of each axis of an edge."""
    rng = np.random.default_rng(seed)
    count = len(truth.matrix)
    ends = np.array([(k, k + 1) for k in range(count - 1)] + [(k, k + columns) for k in range(count - columns)])
    a, b = ends.T
    spread = np.repeat(sigmas, 3)
    motions = truth[a].inverse() @ truth[b] @ SE3.exp(spread * rng.normal(size=(len(ends), 6)))
    poses = [truth.matrix[0]]
    for k in range(count - 1):
        poses.append(poses[-1] @ motions.matrix[k])
    information = np.broadcast_to(np.diag(spread**-2), (len(ends), 6, 6))
    is_robust = np.zeros(len(ends), np.bool_)
    return PoseGraph(np.arange(count), np.array(poses), ends, motions.matrix, information, is_robust)
