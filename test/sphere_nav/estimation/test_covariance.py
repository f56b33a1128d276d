"""The covariance of clustered data against Monte Carlo, where what ignores the clusters is far off."""

import numpy as np
import pytest

from sphere_nav.estimation.covariance import clustered_covariance

NUM_PARTS, SIZE, WHITE, COMMON = 60, 20, 1.0, 0.7  # standard deviations: of one observation, of all of a part together
PRIOR = np.diag([0.5, 4.0]) ** 2


def solve(rng, J):
    """Return an estimate of zero (2,) with what was known beforehand, and its covariance (2, 2)."""
    errors = rng.normal(0.0, WHITE, J.shape[:2]) + rng.normal(0.0, COMMON, (len(J), 1))
    known = np.linalg.inv(PRIOR)
    before = rng.multivariate_normal(np.zeros(2), PRIOR)
    inverse = np.linalg.inv(np.einsum("psi,psj->ij", J, J) + known)
    x = inverse @ (np.einsum("psi,ps->i", J, errors) + known @ before)
    gradients = np.einsum("psi,ps->pi", J, J @ x - errors)
    return x, clustered_covariance(inverse, gradients, known)


@pytest.mark.slow
def test_it_is_that_of_repeated_estimates(rng):
    J = rng.normal([1.0, 0.3], 1.0, (NUM_PARTS, SIZE, 2))  # what is common to a part does not average out
    found = [solve(rng, J) for _ in range(3000)]
    measured, told = np.cov(np.array([x for x, _ in found]).T), np.mean([covariance for _, covariance in found], axis=0)
    sigma = np.sqrt(np.diagonal(measured))
    # 2.6 % by 3000 draws, and the residuals of an estimate of two numbers from 60 parts are some per cent too small
    np.testing.assert_allclose(told / np.outer(sigma, sigma), measured / np.outer(sigma, sigma), atol=0.12)
    independent = np.linalg.inv(np.einsum("psi,psj->ij", J, J)) * (WHITE**2 + COMMON**2)
    assert np.diagonal(measured)[0] > 2.0 * np.diagonal(independent)[0]


def test_what_was_known_adds_its_own(rng):
    inverse, gradients = np.diag([2.0, 3.0]), np.array([[1.0, 2.0], [-1.0, 2.0]])
    np.testing.assert_allclose(clustered_covariance(inverse, gradients, np.diag([0.5, 0.25])), np.diag([18.0, 146.25]))
    assert clustered_covariance(inverse, gradients, np.zeros((2, 2)))[1, 1] == pytest.approx(9.0 * 16.0)
