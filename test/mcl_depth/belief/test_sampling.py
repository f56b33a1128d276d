"""New particles, when they are asked for, and the place carried on between images."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.belief.evidence import Proof
from mcl_depth.belief.motion_model import relative_motion
from mcl_depth.belief.particles import Particles
from mcl_depth.belief.resampling import inject_at_places, sample_gaussian
from mcl_depth.geometry.area import Area
from sphere_nav.geometry import SE3

AREA = Area(np.array([[x, y] for x in range(10) for y in range(6)], float), 1.0)


def test_a_given_covariance_keeps_its_correlations_and_is_never_exact():
    A = np.zeros((6, 6))
    A[[0, 1, 5]] = 0.2 * np.array([[1.0, 0, 0, 0, 0, 0], [0.8, 0.3, 0, 0, 0, 0], [-0.2, 0.1, 0, 0, 0, 0.1]])
    pose = np.array([4.0, 3.0, 2.0])
    found = sample_gaussian(SE3.from_planar(*pose), A @ A.T, AREA, 20_000, np.random.default_rng(5)).poses
    local = np.array([relative_motion(pose, one) for one in found])
    floor = np.diag([0.1, 0.1, np.radians(2.0)]) ** 2  # of a pose that is given as if it were exact
    expected = (A @ A.T)[np.ix_((0, 1, 5), (0, 1, 5))] + floor
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.cov(found.T)[2, 2], expected[2, 2], rtol=0.05)
    np.testing.assert_allclose(
        (R := _turn(2.0)) @ expected @ R.T / np.outer(scale, scale), np.cov(found.T) / np.outer(scale, scale), atol=0.05
    )
    assert local[:, 0].std() == pytest.approx(scale[0], rel=0.1)


def _turn(yaw):
    return SE3.from_planar(0.0, 0.0, yaw).rotation


def test_a_start_off_the_area_is_refused_with_its_distance():
    with pytest.raises(ValueError, match=r"found one 4\.0 m away"):
        sample_gaussian(SE3.from_planar(-4.0, 2.0, 0.0), np.eye(6), AREA, 10, np.random.default_rng(0))


def test_new_particles_scatter_around_the_places_of_a_survey():
    particles = Particles.of_equal_weight(np.tile([100.0, 100.0, 0.0], (10_000, 1)))
    proof = Proof(0.01, poses=np.array([[2.0, 3.0, 0.5]]), shares=np.array([1.0]))
    there = inject_at_places(particles, proof, np.random.default_rng(3)).poses
    new = there[there[:, 0] < 50.0]
    assert len(new) == 3000  # three of ten begin anew
    np.testing.assert_allclose(new.std(axis=0), [0.3, 0.3, np.radians(5.0)], rtol=0.06)  # half a cell, half a step
