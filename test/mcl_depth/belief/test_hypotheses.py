"""Clusters of particles against plain statistics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcl_depth.belief.hypotheses import find_hypotheses
from mcl_depth.belief.particles import Particles


def weighted(poses, weights):
    return replace(Particles.of_equal_weight(poses), weights=weights / weights.sum())


def test_mean_and_covariance_are_weighted_and_keep_their_signs():
    rng = np.random.default_rng(0)
    A = np.array([[0.10, 0.0, 0.0], [-0.06, 0.05, 0.0], [0.02, 0.03, 0.05]])
    poses = np.array([4.0, -3.0, np.pi]) + rng.normal(size=(500, 3)) @ A.T
    weights = rng.uniform(0.1, 2.0, 500)
    (found,) = find_hypotheses(weighted(np.column_stack([poses[:, :2], np.angle(np.exp(1j * poses[:, 2]))]), weights))
    mean = np.average(poses, axis=0, weights=weights)
    np.testing.assert_allclose(found.pose[:2], mean[:2], atol=1e-9)
    assert np.angle(np.exp(1j * (found.pose[2] - mean[2]))) == pytest.approx(0.0, abs=1e-3)  # across the cut at pi
    np.testing.assert_allclose(found.covariance, np.cov(poses.T, aweights=weights, ddof=0), atol=2e-5)
    assert found.covariance[0, 1] < 0 < found.covariance[0, 2]
    assert found.sigma_m == pytest.approx(np.sqrt(np.linalg.eigvalsh(found.covariance[:2, :2]).max()))
    assert found.sigma_rad == pytest.approx(np.sqrt(found.covariance[2, 2]))
    assert found.weight == pytest.approx(1.0)


def test_particles_belong_together_in_bins_of_75_cm_and_30_degrees_that_touch():
    """The first lies in the bin that begins at 0 in all three; the ones beside end at -0.75 and 1.5 m."""
    for other, count in [
        ((1.4, 0.1, 0.1), 1),
        ((1.6, 0.1, 0.1), 2),
        ((-0.8, 0.1, 0.1), 2),
        ((0.1, 1.6, 0.1), 2),
        ((0.1, 0.1, np.radians(61.0)), 2),
        ((0.1, 0.1, np.radians(-31.0)), 2),
    ]:
        poses = np.array([(0.1, 0.1, 0.1), other])
        assert len(find_hypotheses(weighted(poses, np.array([0.6, 0.4])))) == count
