"""Which particles live on: effective size, low-variance sampling, and how many are needed (KLD)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.orientation import NUM_YOUNG
from mcl_depth.belief.particles import Particles

Indices = NDArray[np.int64]
EFFECTIVE_SHARE = 0.5  # resample when fewer than this share of the particles carry the belief
MIN_PARTICLES = 300
BIN_M, BIN_RAD = 0.25, np.radians(10.0)  # of position and heading
KLD_ERROR, KLD_Z = 0.03, 2.33  # largest error of the belief, and the normal quantile of its probability
ROUGHENING = 0.3  # spread of copies of young particles, by the distance of particles at the start


def low_variance_indices(weights: NDArray[np.float64], count: int, start: float) -> Indices:
    """Return `count` indices drawn in proportion to weights (N,), comb-like from `start` in [0, 1).

    Thrun, Burgard, Fox, Probabilistic Robotics, table 4.4: a particle is taken floor or ceil of count * weight times.
    """
    edges = np.cumsum(weights)
    comb = (start + np.arange(count)) / count * edges[-1]
    return np.minimum(np.searchsorted(edges, comb, side="right"), len(weights) - 1).astype(np.int64)


def count_bins(poses: NDArray[np.float64]) -> int:
    """Return how many bins of position and heading poses (N, 3) fill."""
    return len(np.unique(np.floor(poses / np.array([BIN_M, BIN_M, BIN_RAD])).astype(np.int64), axis=0))


def required_particles(bins: int, at_most: int) -> int:
    """Return how many particles keep the error of the belief below `KLD_ERROR`: Fox 2003, eq. 12 (Wilson-Hilferty)."""
    least = min(MIN_PARTICLES, at_most)
    if bins <= 1:
        return least
    k = bins - 1
    a = 2.0 / (9.0 * k)
    return int(np.clip(np.ceil(k / (2.0 * KLD_ERROR) * (1.0 - a + np.sqrt(a) * KLD_Z) ** 3), least, at_most))


def resample(particles: Particles, at_most: int, rng: np.random.Generator, gap: float = 0.0) -> Particles:
    """Draw anew where too few particles carry the belief (algorithm 2, line 22), as many as it needs (KLD).

    `gap` m lay between the particles when they were spread; copies of young ones fill it.
    """
    if particles.effective_size > EFFECTIVE_SHARE * len(particles):
        return particles
    draft = low_variance_indices(particles.weights, at_most, rng.random())
    count = required_particles(count_bins(particles.poses[draft]), at_most)
    draft = low_variance_indices(particles.weights, count, rng.random())
    return _roughen(particles.select(draft), ROUGHENING * gap, rng)


def _roughen(particles: Particles, sigma: float, rng: np.random.Generator) -> Particles:
    """Return the set with a spread of `sigma` m given to the positions of young particles."""
    is_young = particles.ages <= NUM_YOUNG
    if sigma <= 0.0 or not is_young.any():
        return particles
    poses = particles.poses.copy()
    poses[is_young, :2] += sigma * rng.standard_normal((int(is_young.sum()), 2))
    return particles.with_poses(poses)
