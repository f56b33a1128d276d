"""New particles, when they are asked for, and the place carried on between images."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mcl_depth.belief.dead_reckoning import DeadReckoning
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.hypotheses import Hypothesis
from mcl_depth.belief.particles import Particles
from mcl_depth.belief.recovery import Recovery
from mcl_depth.belief.sampling import inject_random, sample_gaussian, sample_uniform
from mcl_depth.geometry.area import Area
from mcl_depth.params import FilterParams, InputParams, RecoveryParams, ResamplingParams
from sphere_geometry import SE3, Spherical

AREA = Area(np.array([[x, y] for x in range(10) for y in range(6)], float), 1.0)
PARAMS = FilterParams(resampling=ResamplingParams(num_particles=2000))


def test_particles_are_spread_over_all_places_and_headings():
    poses = sample_uniform(AREA, 600, np.random.default_rng(1)).poses
    assert np.all(AREA.contains(poses[:, :2]))
    counts, _ = np.histogram(poses[:, 2], bins=6, range=(-np.pi, np.pi))
    assert counts.min() > 60  # 100 expected; 4 standard deviations are 37


def test_particles_gather_as_the_covariance_says_in_the_axes_of_the_pose():
    covariance = np.diag([0.5, 0.1, 0.1, 0.1, 0.1, 0.2]) ** 2
    particles = sample_gaussian(
        SE3.from_planar(4.0, 3.0, np.pi / 2), covariance, AREA, PARAMS, np.random.default_rng(2)
    )
    np.testing.assert_allclose(particles.poses.mean(axis=0), [4.0, 3.0, np.pi / 2], atol=0.05)
    along, across = particles.poses[:, 1].std(), particles.poses[:, 0].std()  # forward is the map's y
    assert along == pytest.approx(np.hypot(0.5, 0.1), rel=0.1)
    assert across == pytest.approx(np.hypot(0.1, 0.1), rel=0.1)


def test_a_share_of_the_particles_is_renewed():
    particles = Particles.of_equal_weight(np.tile([100.0, 100.0, 0.0], (200, 1)))
    alike = comparison_of([0.4])
    moved = inject_random(particles, AREA, 0.25, alike, PARAMS, np.random.default_rng(3)).poses[:, 0] < 50.0
    assert moved.sum() == 50
    assert inject_random(particles, AREA, 0.001, alike, PARAMS, np.random.default_rng(3)) is particles


def test_new_particles_go_where_the_image_fits_with_the_heading_that_fits():
    def curves(positions):
        found = np.full((len(positions), 4), 0.3, np.float32)
        found[:, 1] = np.where(positions[:, 0] < 2.0, 0.9, 0.5)  # a quarter turn fits best, and best in the west
        return found

    particles = Particles.of_equal_weight(np.tile([100.0, 100.0, 0.0], (200, 1)))
    there = inject_random(particles, AREA, 0.25, SimpleNamespace(curves=curves), PARAMS, np.random.default_rng(3)).poses
    new = there[there[:, 0] < 50.0]
    assert len(new) == 50
    assert np.mean(new[:, 0] < 2.0) > 0.95  # (5 / 9) ** 20: one in 100 000 elsewhere
    assert np.mean(there[:, 0] > 50.0) == 0.75
    np.testing.assert_allclose(new[:, 2], np.pi / 2, atol=0.1)


def comparison_of(best):
    """Scouts whose best similarities are given, over again."""
    return SimpleNamespace(curves=lambda positions: np.resize(np.array(best, np.float32), len(positions))[:, None])


def test_the_lead_counts_standard_deviations_of_the_scouts():
    recovery = Recovery(RecoveryParams(scouts_per_image=4), AREA.middles)
    assert recovery.observe(comparison_of([0.4, 0.6]), 0.8) == pytest.approx(3.0, rel=1e-4)  # 0.5 +- 0.1


def test_a_falling_lead_asks_for_particles_and_a_steady_one_for_none():
    recovery = Recovery(RecoveryParams(scouts_per_image=4), AREA.middles)
    for _ in range(10):
        recovery.observe(comparison_of([0.4, 0.6]), 0.9)
    assert recovery.share(is_following=True) == 0.0
    assert recovery.share(is_following=False) == RecoveryParams().lost_share
    for _ in range(10):
        recovery.observe(comparison_of([0.4, 0.6]), 0.5)
    assert recovery.share(is_following=True) == RecoveryParams().max_share


def observe(x, second, odometry=True):
    T = SE3.from_planar(x, 0.0, 0.0) if odometry else None
    return Observation(np.zeros((8, 16), np.uint8), Spherical(16, 8), second * 10**9, np.eye(3), T)


def test_a_place_is_carried_on_by_odometry_in_its_own_heading():
    reckoning = DeadReckoning(InputParams(min_way=0.2))
    best = Hypothesis(np.array([5.0, 5.0, np.pi / 2]), np.eye(3), 0.9, np.arange(1))
    reckoning.update(best, observe(1.0, 1), is_confirmed=True)
    np.testing.assert_allclose(reckoning.propagate(observe(3.0, 2)), [5.0, 7.0, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(reckoning.propagate(observe(3.0, 2, odometry=False)), best.pose)
    assert reckoning.is_near(observe(1.1, 2))
    assert not reckoning.is_near(observe(1.3, 2))
    assert not reckoning.is_near(observe(1.0, 2, odometry=False))


def test_age_counts_from_the_image_that_confirmed_the_place():
    reckoning = DeadReckoning(InputParams())
    best = Hypothesis(np.zeros(3), np.eye(3), 0.9, np.arange(1))
    reckoning.update(best, observe(0.0, 1), is_confirmed=True)
    reckoning.update(best, observe(1.0, 3), is_confirmed=False)
    assert reckoning.age(4 * 10**9) == pytest.approx(3.0)
    reckoning.reset()
    assert (reckoning.best, reckoning.quality) == (None, 0.0)
