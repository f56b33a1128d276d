"""Gates: distances in standard deviations."""

import numpy as np
import pytest
from scipy.stats import chi2

from sphere_nav.estimation.gates import squared_mahalanobis


def test_an_error_counts_by_its_own_deviation():
    assert squared_mahalanobis(np.array([2.0, -3.0]), np.diag([4.0, 1.0])) == pytest.approx(10.0)


def test_errors_with_the_direction_of_the_covariance_are_nearer():
    covariance = np.array([[1.0, 0.9], [0.9, 1.0]])
    assert squared_mahalanobis(np.array([1.0, 1.0]), covariance) == pytest.approx(2.0 / 1.9)
    assert squared_mahalanobis(np.array([1.0, -1.0]), covariance) == pytest.approx(2.0 / 0.1)


def test_normal_errors_are_beyond_a_quantile_as_often_as_it_says(rng):
    A = rng.normal(size=(6, 6))
    found = [squared_mahalanobis(A @ rng.normal(size=6), A @ A.T) for _ in range(4000)]
    assert np.mean(np.array(found) > chi2.ppf(0.9, 6)) == pytest.approx(0.1, abs=0.02)  # 4 standard deviations
