"""Hypotheses of where `level` is: the camera's centre, with the levelled axes of the vehicle (N17 section III-C).

What the curve of similarities over all headings tells about the heading; weights by similarity, w = s ** lambda; which
particles live on; new ones, all over the area, around a given pose, or where the evidence of the last images points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.motion_model import planar_pose, wrap_angle
from mcl_depth.constants import (
    CHANCE,
    EFFECTIVE_SHARE,
    EXPONENT,
    HEADING_SPREAD,
    KLD_BIN,
    KLD_ERROR,
    KLD_Z,
    MIN_PARTICLES,
    NEW_SHARE,
    NUM_YOUNG,
    UNMODELED,
)
from mcl_depth.geometry.area import Area
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import PLANAR, Array


@dataclass(frozen=True)
class Particles:
    """A weighted set: `poses` (N, 3) are x, y in m and yaw in rad in the map; `weights` (N,) sum to 1."""

    poses: Array
    weights: Array
    ages: NDArray[np.int64]  # (N,) images seen since the particle was spread

    def __len__(self) -> int:
        return len(self.poses)

    @staticmethod
    def of_equal_weight(poses: Array, ages: int | NDArray[np.int64] = 0) -> Particles:
        """Return particles of one weight; `ages` of all, or of each."""
        count = len(poses)
        return Particles(poses, np.full(count, 1.0 / max(count, 1)), np.full(count, ages, dtype=np.int64))

    @property
    def effective_size(self) -> float:
        """1 / sum of squared weights: how many particles carry the belief."""
        return float(1.0 / np.sum(self.weights**2))

    def reweight(self, weights: Array) -> Particles:
        """Return the same particles, one image older, with weights scaled to sum 1."""
        return replace(self, weights=weights / weights.sum(), ages=self.ages + 1)


def best_headings(curves: NDArray[np.floating]) -> Array:
    """Return the best heading (N,) rad of curves (N, A), between the steps by a parabola through three of them."""
    count = curves.shape[1]
    best = np.argmax(curves, axis=1)
    rows = np.arange(len(curves))
    before, at, after = (curves[rows, (best + shift) % count].astype(np.float64) for shift in (-1, 0, 1))
    bend = before - 2.0 * at + after
    offset = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)
    return wrap_angle((best + np.clip(offset, -0.5, 0.5)) * (2.0 * np.pi / count))


def interpolate_similarity(curves: NDArray[np.floating], headings: Array) -> Array:
    """Return the similarity (N,) at headings (N,) rad, linear between the steps of curves (N, A)."""
    count = curves.shape[1]
    place = (headings / (2.0 * np.pi) * count) % count
    first = np.floor(place).astype(np.int64) % count
    share = place - np.floor(place)
    rows = np.arange(len(curves))
    return (1.0 - share) * curves[rows, first] + share * curves[rows, (first + 1) % count]


def adjust_headings(particles: Particles, curves: NDArray[np.floating], rng: np.random.Generator) -> Particles:
    """Turn young particles to their best heading, which keeps a small spread (algorithm 2, line 19)."""
    is_young = particles.ages < NUM_YOUNG
    if not is_young.any():
        return particles
    poses = particles.poses.copy()
    spread = HEADING_SPREAD * rng.standard_normal(len(particles))
    poses[:, 2] = np.where(is_young, wrap_angle(best_headings(curves) + spread), poses[:, 2])
    return replace(particles, poses=poses)


def low_variance_indices(weights: NDArray[np.float64], count: int, start: float) -> NDArray[np.int64]:
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
    local = covariance[PLANAR] + np.diag(UNMODELED[[0, 1, 5]] ** 2)
    poses = rng.multivariate_normal(pose, R @ local @ R.T, count, method="cholesky")
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Particles.of_equal_weight(poses, NUM_YOUNG)


def inject_at_places(
    particles: Particles, poses: Array, shares: Array, sigmas: Array, rng: np.random.Generator
) -> Particles:
    """Return the set with a part of its particles, drawn by lot, put around poses (K, 3) by their shares (K,).

    A mixture of proposals (Thrun, Burgard, Fox, section 8.3.5); they keep the headings found there.
    """
    count = int(NEW_SHARE * len(particles))
    places = poses[rng.choice(len(poses), count, p=shares)] + sigmas * rng.standard_normal((count, 3))
    places[:, 2] = wrap_angle(places[:, 2])
    replaced = rng.choice(len(particles), count, replace=False)
    all_poses, ages = particles.poses.copy(), particles.ages.copy()
    all_poses[replaced], ages[replaced] = places, NUM_YOUNG
    return replace(particles, poses=all_poses, ages=ages)
