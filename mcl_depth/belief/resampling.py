"""Particles: their weights by similarity, w = s ** lambda (N17 section III-C), which of them live on, and new ones.

New ones lie all over the area, around a given pose, or where the evidence of the last images points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.evidence import Proof
from mcl_depth.belief.motion_model import planar_pose
from mcl_depth.belief.particles import Particles, wrap_angle
from mcl_depth.constants import (
    CHANCE,
    EFFECTIVE_SHARE,
    EXPONENT,
    GIVEN_SIGMA,
    KLD_BIN,
    KLD_ERROR,
    KLD_Z,
    MIN_PARTICLES,
    NEW_SHARE,
    NEW_SIGMA,
    NUM_YOUNG,
)
from mcl_depth.geometry.area import Area
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import PLANAR, Array

Indices = NDArray[np.int64]


def low_variance_indices(weights: NDArray[np.float64], count: int, start: float) -> Indices:
    """Return `count` indices drawn in proportion to weights (N,), comb-like from `start` in [0, 1).

    Thrun, Burgard, Fox, Probabilistic Robotics, table 4.4: a particle is taken floor or ceil of count * weight times.
    """
    edges = np.cumsum(weights)
    comb = (start + np.arange(count)) / count * edges[-1]
    return np.minimum(np.searchsorted(edges, comb, side="right"), len(weights) - 1).astype(np.int64)


def count_bins(poses: NDArray[np.float64]) -> int:
    """Return how many bins of position and heading poses (N, 3) fill."""
    return len(np.unique(np.floor(poses / KLD_BIN).astype(np.int64), axis=0))


def required_particles(bins: int, at_most: int) -> int:
    """Return how many particles keep the error of the belief below `KLD_ERROR`: Fox 2003, eq. 12 (Wilson-Hilferty)."""
    least = min(MIN_PARTICLES, at_most)
    if bins <= 1:
        return least
    k = bins - 1
    a = 2.0 / (9.0 * k)
    return int(np.clip(np.ceil(k / (2.0 * KLD_ERROR) * (1.0 - a + np.sqrt(a) * KLD_Z) ** 3), least, at_most))


def resample(particles: Particles, at_most: int, rng: np.random.Generator) -> Particles:
    """Draw anew where too few particles carry the belief (algorithm 2, line 22), as many as it needs (KLD)."""
    if particles.effective_size > EFFECTIVE_SHARE * len(particles):
        return particles
    draft = low_variance_indices(particles.weights, at_most, rng.random())
    count = required_particles(count_bins(particles.poses[draft]), at_most)
    chosen = low_variance_indices(particles.weights, count, rng.random())
    return Particles.of_equal_weight(particles.poses[chosen], particles.ages[chosen])


def scale_similarities(similarities: Array) -> Array:
    """Scale similarities (N,) so that the largest is 1 and what chance gives, or less, is 0."""
    high = float(similarities.max())
    if not high > CHANCE:
        return np.ones(len(similarities))
    return np.clip((similarities - CHANCE) / (high - CHANCE), 0.0, 1.0)


def compute_weights(similarities: Array, prior: Array) -> Array:
    """Return weights (N,) of sum 1: `prior` times s ** lambda; all alike where nothing distinguishes them."""
    result = prior * scale_similarities(similarities) ** EXPONENT
    total = float(result.sum())
    return result / total if total > 0.0 else np.full(len(result), 1.0 / len(result))


def sample_uniform(area: Area, count: int, rng: np.random.Generator) -> Particles:
    """Return particles all over the area, of any heading (algorithm 2, line 1)."""
    poses = np.column_stack([area.draw(count, rng), rng.uniform(-np.pi, np.pi, count)])
    return Particles.of_equal_weight(poses)


def sample_gaussian(T_map_level: SE3, covariance: Array, area: Area, count: int, rng: np.random.Generator) -> Particles:
    """Return particles around a pose with local covariance (6, 6); they keep their own headings."""
    pose = planar_pose(T_map_level)
    if not area.contains(pose[None, :2])[0]:
        nearest = float(np.min(np.linalg.norm(area.middles - pose[:2], axis=1)))
        raise ValueError(
            f"initial pose: expected a place in the area of the cloud, found one {nearest:.1f} m away from it"
        )
    R = so3.exp([0.0, 0.0, pose[2]])  # of x and y; the variance of yaw is the same in all axes
    local = covariance[PLANAR] + np.diag(GIVEN_SIGMA) ** 2
    poses = rng.multivariate_normal(pose, R @ local @ R.T, count, method="cholesky")
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Particles.of_equal_weight(poses, NUM_YOUNG)


def inject_at_places(particles: Particles, proof: Proof, rng: np.random.Generator) -> Particles:
    """Return the set with a share of its particles, drawn by lot, put around the best places of the map.

    A mixture of proposals (Thrun, Burgard, Fox, section 8.3.5); they keep the headings found there.
    """
    count = int(NEW_SHARE * len(particles))
    places = proof.poses[rng.choice(len(proof.poses), count, p=proof.shares)]
    places = places + NEW_SIGMA * rng.standard_normal((count, 3))
    places[:, 2] = wrap_angle(places[:, 2])
    replaced = rng.choice(len(particles), count, replace=False)
    poses, ages = particles.poses.copy(), particles.ages.copy()
    poses[replaced], ages[replaced] = places, NUM_YOUNG
    return replace(particles, poses=poses, ages=ages)
