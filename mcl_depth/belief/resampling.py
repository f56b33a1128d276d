"""Which particles live on: effective size, low-variance sampling, and how many are needed (KLD)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.particles import Particles
from mcl_depth.params import ResamplingParams

Indices = NDArray[np.int64]


def low_variance_indices(weights: NDArray[np.float64], count: int, start: float) -> Indices:
    """Return `count` indices drawn in proportion to weights (N,), comb-like from `start` in [0, 1).

    Thrun, Burgard, Fox, Probabilistic Robotics, table 4.4: a particle is taken floor or ceil of count * weight times.
    """
    edges = np.cumsum(weights)
    comb = (start + np.arange(count)) / count * edges[-1]
    return np.minimum(np.searchsorted(edges, comb, side="right"), len(weights) - 1).astype(np.int64)


def count_bins(poses: NDArray[np.float64], params: ResamplingParams) -> int:
    """Return how many bins of position and heading poses (N, 3) fill."""
    widths = np.array([params.bin_size, params.bin_size, np.radians(params.bin_heading_deg)])
    return len(np.unique(np.floor(poses / widths).astype(np.int64), axis=0))


def required_particles(bins: int, params: ResamplingParams) -> int:
    """Return how many particles keep the error of the belief below `kld_error` with probability `kld_quantile`.

    Fox 2003, eq. 12 (Wilson-Hilferty), bounded by the parameters.
    """
    if bins <= 1:
        return params.min_particles
    k, z = bins - 1, params.kld_z
    a = 2.0 / (9.0 * k)
    needed = k / (2.0 * params.kld_error) * (1.0 - a + np.sqrt(a) * z) ** 3
    return int(np.clip(np.ceil(needed), params.min_particles, params.num_particles))


def resample(
    particles: Particles, params: ResamplingParams, rng: np.random.Generator, gap: float = 0.0, num_young: int = 0
) -> Particles:
    """Draw anew where too few particles carry the belief (algorithm 2, line 22).

    `gap` m lay between the particles when they were spread; copies of those younger than `num_young` images fill it.
    """
    if particles.effective_size > params.effective_share * len(particles):
        return particles
    draft = low_variance_indices(particles.weights, params.num_particles, rng.random())
    if params.is_adaptive:
        count = required_particles(count_bins(particles.poses[draft], params), params)
        draft = low_variance_indices(particles.weights, count, rng.random())
    return _roughen(particles.select(draft), params.roughening * gap, num_young, rng)


def _roughen(particles: Particles, sigma: float, num_young: int, rng: np.random.Generator) -> Particles:
    """Return the set with a spread of `sigma` m given to the positions of young particles."""
    is_young = particles.ages <= num_young
    if sigma <= 0.0 or not is_young.any():
        return particles
    poses = particles.poses.copy()
    poses[is_young, :2] += sigma * rng.standard_normal((int(is_young.sum()), 2))
    return particles.with_poses(poses)
