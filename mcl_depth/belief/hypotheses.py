"""The belief in a few words: clusters of particles, each with a pose, a covariance and a weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mcl_depth.belief.particles import Particles, wrap_angle
from mcl_depth.constants import CLUSTER_M, MAX_HYPOTHESES, NUM_TURNS
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True)
class Hypothesis:
    """One place: x, y, yaw (3,) in the map, covariance (3, 3) in the map's axes, share of the belief."""

    pose: Array
    covariance: Array
    weight: float

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position, the larger axis."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    @property
    def sigma_rad(self) -> float:
        """Standard deviation of the heading."""
        return float(np.sqrt(self.covariance[2, 2]))


def find_hypotheses(particles: Particles) -> list[Hypothesis]:
    """Return the clusters by falling weight: particles in bins of position and heading that touch belong together."""
    labels = _labels(particles.poses)
    shares = np.bincount(labels, particles.weights)
    order = np.argsort(-shares, kind="stable")[:MAX_HYPOTHESES]
    return [_hypothesis(particles, np.flatnonzero(labels == label)) for label in order]


def _labels(poses: Array) -> NDArray[np.int64]:
    """Return the number (N,) of the cluster of each pose (N, 3)."""
    turn = np.floor(wrap_angle(poses[:, 2]) / (2.0 * np.pi) * NUM_TURNS).astype(np.int64) % NUM_TURNS
    cells = np.floor(poses[:, :2] / CLUSTER_M).astype(np.int64)
    bins, bin_of = np.unique(np.column_stack([cells, turn]), axis=0, return_inverse=True)
    around = cKDTree(bins, boxsize=[0.0, 0.0, NUM_TURNS])  # headings wrap around
    rows, columns = around.query_pairs(1.5, np.inf, output_type="ndarray").T
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(bins), len(bins)))
    return connected_components(links, directed=False)[1][bin_of.ravel()].astype(np.int64)


def _hypothesis(particles: Particles, members: NDArray[np.int64]) -> Hypothesis:
    poses, weights = particles.poses[members], particles.weights[members]
    total = float(weights.sum())
    share = weights / total if total > 0.0 else np.full(len(members), 1.0 / len(members))
    yaw = np.arctan2(share @ np.sin(poses[:, 2]), share @ np.cos(poses[:, 2]))
    pose = np.array([*(share @ poses[:, :2]), yaw])
    errors = poses - pose
    errors[:, 2] = wrap_angle(errors[:, 2])
    return Hypothesis(pose, (errors * share[:, None]).T @ errors, total)
