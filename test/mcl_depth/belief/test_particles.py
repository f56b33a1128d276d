"""How many particles live on, and which."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcl_depth.belief.motion_model import relative_motion
from mcl_depth.belief.particles import (
    Particles,
    adjust_headings,
    compute_weights,
    count_bins,
    inject_at_places,
    low_variance_indices,
    required_particles,
    resample,
    sample_gaussian,
    scale_similarities,
)
from mcl_depth.constants import CHANCE
from mcl_depth.geometry.area import Area
from sphere_nav.geometry import SE3

NUM_YOUNG = 2


def test_the_low_variance_sampler_takes_floor_or_ceil_of_each_share():
    rng = np.random.default_rng(3)
    shares = rng.dirichlet(np.ones(20))
    for start in (0.0, 0.4, 0.99):
        counts = np.bincount(low_variance_indices(shares, 500, start), minlength=20)
        assert np.all(np.abs(counts - 500 * shares) < 1.0)
        assert counts.sum() == 500


def test_there_are_never_fewer_than_a_least_number_nor_more_than_allowed():
    for bins, at_most, count in [(1, 1000, 300), (1, 100, 100), (999, 1000, 1000)]:
        assert required_particles(bins, at_most) == count


def test_bins_are_a_quarter_of_a_metre_and_ten_degrees():
    at = np.array([0.1, -0.4, np.radians(3.0)])
    for axis, side in enumerate((0.25, 0.25, np.radians(10.0))):
        poses = np.tile(at, (41, 1))
        poses[:, axis] += np.linspace(0.0, 4.0 * side, 41)
        assert count_bins(poses) == 5
    assert count_bins(np.array([[0.0, 0.0, 0.0], [0.3, 0.3, 0.0], [0.3, 0.0, 0.0]])) == 3


@pytest.mark.parametrize(("num_alive", "is_kept"), [(51, True), (50, False)])
def test_the_set_is_kept_while_more_than_half_carry_the_belief(num_alive, is_kept):
    weights = np.zeros(100)
    weights[:num_alive] = 1.0 / num_alive
    particles = replace(Particles.of_equal_weight(np.zeros((100, 3))), weights=weights)
    found = resample(particles, 100, np.random.default_rng(0))
    assert (found is particles) == is_kept
    if not is_kept:
        np.testing.assert_allclose(found.weights, 1.0 / len(found))


def test_a_place_that_looks_like_chance_weighs_nothing():
    np.testing.assert_allclose(scale_similarities(CHANCE + np.array([-0.1, 0.0, 0.05, 0.2])), [0.0, 0.0, 0.25, 1.0])
    np.testing.assert_array_equal(scale_similarities(CHANCE - np.array([0.1, 0.0])), [1.0, 1.0])
    angles = np.random.default_rng(0).uniform(0.0, 2 * np.pi, 10**6)  # between gradients that have nothing in common
    assert pytest.approx(2 * np.abs(np.cos(angles)).mean(), rel=2e-3) == CHANCE


def test_lambda_is_that_of_the_paper():
    """N17 table I: lambda = 20."""
    found = compute_weights(CHANCE + np.array([0.99, 1.0]), np.array([0.5, 0.5]))
    assert found[0] / found[1] == pytest.approx(0.99**20, rel=1e-6)


def test_young_particles_turn_to_their_best_heading_and_the_others_do_not():
    count = 4000
    curves = np.cos(np.arange(36) * np.radians(10.0) - np.radians(-40.0))[None].repeat(count, axis=0)
    ages = np.where(np.arange(count) % 2, NUM_YOUNG, NUM_YOUNG - 1)
    particles = replace(Particles.of_equal_weight(np.tile([1.0, 2.0, 3.0], (count, 1))), ages=ages)
    found = adjust_headings(particles, curves, np.random.default_rng(0)).poses
    np.testing.assert_array_equal(found[1::2], particles.poses[1::2])
    np.testing.assert_array_equal(found[:, :2], particles.poses[:, :2])
    assert np.degrees(found[::2, 2].mean()) == pytest.approx(-40.0, abs=0.3)
    assert np.degrees(found[::2, 2].std()) == pytest.approx(3.0, rel=0.1)


AREA = Area(np.array([[x, y] for x in range(10) for y in range(6)], float), 1.0)


def test_a_given_covariance_keeps_its_correlations_and_is_never_exact():
    A = np.zeros((6, 6))
    A[[0, 1, 5]] = 0.2 * np.array([[1.0, 0, 0, 0, 0, 0], [0.8, 0.3, 0, 0, 0, 0], [-0.2, 0.1, 0, 0, 0, 0.1]])
    pose = np.array([4.0, 3.0, 2.0])
    found = sample_gaussian(SE3.from_planar(*pose), A @ A.T, AREA, 20_000, np.random.default_rng(5)).poses
    local = np.array([relative_motion(pose, one) for one in found])
    floor = np.diag([0.1, 0.1, np.radians(1.0)]) ** 2  # of a pose that is given as if it were exact
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
    sigmas, rng = np.array([0.3, 0.2, np.radians(5.0)]), np.random.default_rng(3)
    there = inject_at_places(particles, np.array([[2.0, 3.0, 0.5]]), np.ones(1), sigmas, rng).poses
    new = there[there[:, 0] < 50.0]
    assert len(new) == 3000  # three of ten begin anew
    np.testing.assert_allclose(new.std(axis=0), sigmas, rtol=0.06)
