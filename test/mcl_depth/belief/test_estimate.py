"""Covariances of the pose against Monte Carlo."""

from __future__ import annotations

import numpy as np

from mcl_depth.belief.estimate import level_pose, pose_covariance
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
