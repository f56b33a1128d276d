"""New particles: all over the area, around a given pose, or some in the place of old ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.motion_model import planar_pose
from mcl_depth.belief.orientation import best_headings
from mcl_depth.belief.particles import Particles, wrap_angle
from mcl_depth.belief.resampling import low_variance_indices
from mcl_depth.belief.weighting import compute_weights
from mcl_depth.geometry.area import Area
from mcl_depth.likeness.similarity_cache import Comparison
from mcl_depth.params import FilterParams
from sphere_geometry import SE3

Array = NDArray[np.float64]
MIN_SIGMA_M, MIN_SIGMA_RAD = 0.1, np.radians(2.0)  # of a pose that is given as if it were exact


def sample_uniform(area: Area, count: int, rng: np.random.Generator) -> Particles:
    """Return particles all over the area, of any heading (algorithm 2, line 1)."""
    return Particles.of_equal_weight(_anywhere(area, count, rng))


def sample_gaussian(
    T_map_level: SE3, covariance: Array, area: Area, params: FilterParams, rng: np.random.Generator
) -> Particles:
    """Return particles around a pose with local covariance (6, 6); they keep their own headings."""
    pose = planar_pose(T_map_level)
    if not area.contains(pose[None, :2])[0]:
        nearest = float(np.min(np.linalg.norm(area.middles - pose[:2], axis=1)))
        raise ValueError(
            f"initial pose: expected a place in the area of the cloud, found one {nearest:.1f} m away from it"
        )
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    local = covariance[np.ix_((0, 1, 5), (0, 1, 5))] + np.diag([MIN_SIGMA_M, MIN_SIGMA_M, MIN_SIGMA_RAD]) ** 2
    poses = rng.multivariate_normal(pose, R @ local @ R.T, params.resampling.num_particles, method="cholesky")
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Particles.of_equal_weight(poses, params.adjustment.num_images)


def inject_random(
    particles: Particles,
    area: Area,
    share: float,
    comparison: Comparison,
    params: FilterParams,
    rng: np.random.Generator,
) -> Particles:
    """Return the set with a share of its particles, drawn by lot, put where the image fits, anywhere in the area.

    For each new particle some positions all over the area are looked at; those live on that fit best, by lot, as in
    resampling, each with its best heading, where headings are adjusted at all (mixture of proposals: Thrun, Burgard,
    Fox, section 8.3.5).
    """
    count = int(share * len(particles))
    if not count:
        return particles
    positions = area.draw(count * params.recovery.tries, rng)
    curves = comparison.curves(positions)
    fit = compute_weights(
        curves.max(axis=1).astype(np.float64), params.weight, np.full(len(positions), 1.0 / len(positions))
    )
    chosen = low_variance_indices(fit, count, rng.random())
    indices = rng.choice(len(particles), count, replace=False)
    headings = best_headings(curves[chosen]) if params.adjustment.initial > 0.0 else rng.uniform(-np.pi, np.pi, count)
    return particles.replace_some(indices, np.column_stack([positions[chosen], headings]))


def _anywhere(area: Area, count: int, rng: np.random.Generator) -> Array:
    return np.column_stack([area.draw(count, rng), rng.uniform(-np.pi, np.pi, count)])
