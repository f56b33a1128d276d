"""A gate turns away as large a share of what belongs together as it says."""

import numpy as np
import pytest
from scipy.stats import chi2

from sphere_nav.estimation.gates import gate, squared_distance, squared_mahalanobis
from sphere_nav.geometry import SE3


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
