"""Gates: distances in standard deviations."""

import numpy as np
import pytest
from scipy.stats import chi2

from sphere_nav.estimation.gates import squared_distance, squared_mahalanobis
from sphere_nav.geometry import SE3


def test_errors_with_the_direction_of_the_covariance_are_nearer():
    covariance = np.array([[1.0, 0.9], [0.9, 1.0]])
    assert squared_mahalanobis(np.array([1.0, 1.0]), covariance) == pytest.approx(2.0 / 1.9)
    assert squared_mahalanobis(np.array([1.0, -1.0]), covariance) == pytest.approx(2.0 / 0.1)


def test_normal_errors_are_beyond_a_quantile_as_often_as_it_says(rng):
    A = rng.normal(size=(6, 6))
    found = [squared_mahalanobis(A @ rng.normal(size=6), A @ A.T) for _ in range(4000)]
    assert np.mean(np.array(found) > chi2.ppf(0.9, 6)) == pytest.approx(0.1, abs=0.02)  # 4 standard deviations


def test_poses_are_apart_by_the_tangent_vector_in_the_axes_of_the_first(rng):
    T_a, xi = SE3.exp(rng.normal(size=6)), 0.1 * rng.normal(size=6)
    covariance = np.diag([4.0, 1.0, 1.0, 0.25, 1.0, 1.0])
    there = squared_distance(T_a, T_a @ SE3.exp(xi), covariance)
    assert there == pytest.approx(squared_mahalanobis(xi, covariance))
    assert squared_distance(SE3.exp(rng.normal(size=6)) @ T_a, T_a @ SE3.exp(xi), covariance) > 4.0 * there
    moved = SE3.exp(rng.normal(size=6))  # another frame of the map changes nothing
    assert squared_distance(moved @ T_a, moved @ T_a @ SE3.exp(xi), covariance) == pytest.approx(there)
