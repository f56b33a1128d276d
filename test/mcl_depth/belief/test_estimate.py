"""Clusters of particles against plain statistics, covariances of the pose against Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcl_depth.belief.estimate import find_hypotheses, level_pose, pose_covariance
from mcl_depth.belief.particles import Particles
from sphere_nav.geometry import SE3


def test_the_local_covariance_is_that_of_the_particles_turned_into_the_axes_of_the_pose_and_of_the_map():
    rng, pose = np.random.default_rng(1), np.array([3.0, -2.0, -0.6])
    A = np.array([[0.05, 0.0, 0.0], [0.03, 0.02, 0.0], [0.01, -0.01, 0.015]])
    poses = pose + rng.normal(size=(40_000, 3)) @ A.T
    T = level_pose(pose, 1.5)
    np.testing.assert_allclose(T.matrix, SE3.from_planar(*pose).matrix + np.outer([0, 0, 1.5, 0], [0, 0, 0, 1]))
    xi = np.array([(T.inverse() @ level_pose(one, 1.5)).log() for one in poses[:8000]])
    floor = np.diag(np.array([0.10, 0.10, 0.10, *np.radians([1.0, 1.0, 1.0])]) ** 2)  # what particles do not tell
    sigma = np.sqrt(np.diag(A @ A.T))
    scale = np.array([sigma[0], sigma[0], 1.0, 1.0, 1.0, sigma[2]])
    found = pose_covariance(A @ A.T, pose[2]) - floor
    np.testing.assert_allclose(found / np.outer(scale, scale), np.cov(xi.T) / np.outer(scale, scale), atol=0.06)
    assert abs(found[0, 1]) > 0.2 * sigma[0] ** 2  # turned the other way it has the other sign
    found = np.sqrt(np.diag(pose_covariance(np.zeros((3, 3)), 1.0)))
    np.testing.assert_allclose(found, [0.1, 0.1, 0.1, *np.radians([1.0, 1.0, 1.0])])


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
