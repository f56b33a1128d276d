"""Scaled solves, the covariance against Monte Carlo, gates as rare as told, robust weights by their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from sphere_nav.estimation import kernels
from sphere_nav.estimation.least_squares import (
    cauchy_weights,
    clustered_covariance,
    gate,
    huber_weights,
    inverse_and_condition,
    median_and_mad,
    scaled_inverse,
    scaled_step,
    squared_distance,
    squared_mahalanobis,
    symmetric_inverse,
    weigh,
    weighted_step,
)
from sphere_nav.geometry import SE3

RIDGE = 1e-9  # written out: imported, a change would go unseen

UNITS = np.array([1e6, 1.0, 1e-6])


@pytest.fixture
def J(rng):
    return rng.normal(size=(50, 3)) * UNITS


def test_the_step_takes_the_residuals_away(J, rng):
    x = np.array([1.0, -2.0, 3.0]) / UNITS
    np.testing.assert_allclose(weighted_step(J, -J @ x, rng.uniform(0.5, 2.0, 50)), x, rtol=1e-6)
    np.testing.assert_allclose(scaled_step(J.T @ J, -J.T @ (J @ x)), x, rtol=1e-6)


def test_what_is_not_seen_has_no_covariance_with_the_rest(J):
    J[:, 1] = 0.0
    found = scaled_inverse(J.T @ J)
    assert 1e100 < found[1, 1] < np.inf  # a number: nothing times it is nothing
    seen = np.ix_((0, 2), (0, 2))
    np.testing.assert_allclose(found[seen], np.linalg.inv((J.T @ J)[seen]), rtol=1e-6)
    np.testing.assert_array_equal(found[1, [0, 2]], 0.0)


def test_two_that_cannot_be_told_apart_share_what_the_ridge_leaves():
    H = np.outer([1e3, 1.0], [1e3, 1.0])  # only their sum is seen
    expected = 0.5 / RIDGE * np.outer([1e-3, -1.0], [1e-3, -1.0])
    np.testing.assert_allclose(scaled_inverse(H), expected, rtol=1e-3)
    np.testing.assert_allclose(scaled_step(H, np.array([1e3, 1.0])), [-0.5e-3, -0.5], rtol=1e-6)
    assert scaled_step(H, np.array([0.0, RIDGE]))[1] == pytest.approx(-0.5, rel=1e-3)


def test_the_inverse_is_the_covariance_of_the_step(J, rng):
    steps = np.array([weighted_step(J, rng.normal(0.0, 0.3, 50), np.full(50, 0.3**-2)) for _ in range(4000)])
    H = J.T @ J / 0.3**2
    covariance = scaled_inverse(H) * np.outer(UNITS, UNITS)
    measured = np.cov(steps.T) * np.outer(UNITS, UNITS)
    sigma = np.sqrt(np.diagonal(covariance))
    # the standard deviation of a sampled covariance is at most sqrt(2 / 4000) = 0.022 of the variances
    np.testing.assert_allclose(measured / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=0.09)
    np.testing.assert_allclose(inverse_and_condition(H)[0] * np.outer(UNITS, UNITS), covariance, rtol=1e-5, atol=1e-9)


def test_what_is_not_positive_definite_is_unknown():
    for H in [np.diag([1.0, np.nan]), np.diag([1.0, 0.0]), np.array([[1.0, 2.0], [2.0, 1.0]])]:
        inverse, condition = inverse_and_condition(H)
        assert np.all(np.diagonal(inverse) == np.inf)
        assert condition == np.inf


def test_a_symmetric_inverse_is_symmetric_to_the_last_bit(J):
    H = J.T @ J
    inverse = symmetric_inverse(H)
    np.testing.assert_array_equal(inverse, inverse.T)
    np.testing.assert_allclose(inverse @ H, np.eye(3), atol=1e-9 * np.outer(1 / UNITS, UNITS).max())


def test_what_was_known_adds_its_own(rng):
    inverse, gradients = np.diag([2.0, 3.0]), np.array([[1.0, 2.0], [-1.0, 2.0]])
    known = np.diag([0.5, 0.25])
    found = clustered_covariance(inverse, gradients, np.arange(2), known=known)
    np.testing.assert_allclose(found, np.diag([18.0, 146.25]))
    assert clustered_covariance(inverse, gradients, np.arange(2))[1, 1] == pytest.approx(9.0 * 16.0)
    both = clustered_covariance(inverse, np.repeat(gradients, 3, axis=0), np.repeat([4, 7], 3), num_fitted=0)
    np.testing.assert_allclose(both, 9.0 * np.diag([2.0 * 4.0, 8.0 * 9.0]))


def test_newton_step_finds_the_minimum_of_the_quadratic_and_refuses_what_is_not_positive_definite(rng):
    A = rng.normal(size=(8, 20)) * 10.0 ** rng.integers(-3, 4, (8, 1))
    H, g = A @ A.T, rng.normal(size=8)
    x, is_found = kernels.newton_step(H, g, 0)
    assert is_found
    assert np.abs(H @ x + g).max() < 1e-9 * np.abs(g).max()
    rest, _ = kernels.newton_step(H, g, 3)  # a pure rotation leaves the translation out
    assert np.abs(H[3:, 3:] @ rest + g[3:]).max() < 1e-9 * np.abs(g).max()
    for spoil in [0.0, -1.0, np.nan, np.inf]:
        H[3, :] = H[:, 3] = 0.0
        H[3, 3] = spoil
        assert not kernels.newton_step(H, g, 0)[1]


def test_a_gate_is_the_quantile_that_chance_exceeds_at_its_rate():
    for dof, rate in [(1, 0.05), (3, 1e-4), (6, 0.05), (8, 5e-4)]:
        assert chi2.sf(gate(dof, rate), dof) == pytest.approx(rate, rel=1e-9)
    assert chi2.sf(gate(6), 6) == pytest.approx(1e-3, rel=1e-9)


def test_poses_that_err_by_their_covariance_are_as_far_apart_as_chi_squared_says(rng):
    root = rng.normal(size=(6, 6)) * [0.1, 0.1, 0.1, 0.02, 0.02, 0.02]
    covariance, T = root.T @ root, SE3.exp(rng.normal(size=6))
    xi = rng.multivariate_normal(np.zeros(6), covariance, 3000)
    found = [squared_distance(T, T @ SE3.exp(one), covariance) for one in xi]
    np.testing.assert_allclose(found[:9], [squared_mahalanobis(one, covariance) for one in xi[:9]], rtol=1e-9)
    assert np.mean(np.array(found) > gate(6, 0.05)) == pytest.approx(0.05, abs=0.016)  # four standard errors


CAUCHY, HUBER = 2.385, 1.345  # written out: imported, a change would go unseen


def test_median_and_mad_are_those_of_what_is_known():
    assert median_and_mad(np.array([1.0, np.nan, 2.0, 4.0, 9.0])) == (3.0, 1.5)


def test_huber_weights_fall_as_the_share_beyond_the_bound_and_cauchy_weights_are_half_at_the_scale():
    np.testing.assert_array_equal(huber_weights(np.array([0.0, 1.0, 2.0, 4.0, 8.0]), 2.0), [1.0, 1.0, 1.0, 0.5, 0.25])
    np.testing.assert_array_equal(huber_weights(np.array([0.0, 1e9]), np.inf), [1.0, 1.0])
    assert np.isnan(huber_weights(np.array([np.nan]), 2.0)[0])
    np.testing.assert_allclose(cauchy_weights(np.array([0.0, 1.0, 9.0])), [1.0, 0.5, 0.1])


def test_both_constants_are_95_percent_efficient_for_normal_errors():
    """The variance of an M-estimate of a mean is E[psi^2] / E[psi']^2, that of the mean is 1."""
    for weights in [lambda e: huber_weights(np.abs(e), HUBER), lambda e: cauchy_weights((e / CAUCHY) ** 2)]:
        e = np.random.default_rng(5).normal(size=400_000)
        psi, step = weights(e) * e, 1e-4
        slope = (weights(e + step) * (e + step) - psi) / step
        assert np.mean(slope) ** 2 / np.mean(psi**2) == pytest.approx(0.95, abs=0.003)


def test_weigh_divides_by_the_variance_of_the_middle_half():
    residual = np.append(np.random.default_rng(6).normal(7.0, 3.0, 20_000), 1e4)
    weight, sigma = weigh(residual, 1.0)
    assert sigma == pytest.approx(3.0, rel=0.02)
    assert weight.max() == pytest.approx(1.0 / sigma**2)
    assert weight[-1] == pytest.approx(HUBER * sigma / (1e4 - np.median(residual)) / sigma**2)
    assert weigh(np.zeros(9), 0.5)[1] == 0.5
