"""Robust weights against their definitions and limits."""

import numpy as np
import pytest

from sphere_nav.estimation.robust import cauchy_weights, huber_weights, median_and_mad, weigh

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
