"""New particles: all over the area, around a given pose, or where the evidence of the last images points."""

from __future__ import annotations

import numpy as np

from mcl_depth.belief.evidence import Survey
from mcl_depth.belief.motion_model import planar_pose
from mcl_depth.belief.particles import Particles, wrap_angle
from mcl_depth.constants import GIVEN_SIGMA, NEW_SHARE, NEW_SIGMA, NUM_YOUNG
from mcl_depth.geometry.area import Area
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import PLANAR, Array


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
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    local = covariance[PLANAR] + np.diag(GIVEN_SIGMA) ** 2
    poses = rng.multivariate_normal(pose, R @ local @ R.T, count, method="cholesky")
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Particles.of_equal_weight(poses, NUM_YOUNG)


def inject_at_places(particles: Particles, survey: Survey, rng: np.random.Generator) -> Particles:
    """Return the set with a share of its particles, drawn by lot, put around the best places of a survey.

    A mixture of proposals (Thrun, Burgard, Fox, section 8.3.5); they keep the headings of the survey.
    """
    count = int(NEW_SHARE * len(particles))
    poses = survey.poses[rng.choice(len(survey.poses), count, p=survey.shares)]
    poses = poses + NEW_SIGMA * rng.standard_normal((count, 3))
    poses[:, 2] = wrap_angle(poses[:, 2])
    return particles.replace_some(rng.choice(len(particles), count, replace=False), poses, NUM_YOUNG)
