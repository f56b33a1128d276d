"""From the camera to the base: pose, covariance and velocity of one rigid body."""

import numpy as np
import pytest

from dense_localizer.judge.estimate import CameraEstimate
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status

T_BASE_CAMERA = SE3.exp([0.5, 0.1, 1.2, -0.3, 0.2, 1.1])
T_MAP_CAMERA = SE3.exp([3.0, 1.0, 1.0, 0.1, -0.2, 0.7])


def test_without_a_pose_only_the_status_is_left():
    estimate = CameraEstimate(Status(State.LOST)).expose_candidate().to_base(T_BASE_CAMERA)
    assert (estimate.status.state, estimate.T_map_base) == (State.LOST, None)


def test_errors_and_velocity_of_the_camera_are_those_of_the_base(rng):
    covariance = np.diag([1e-4, 2e-4, 3e-4, 4e-6, 5e-6, 6e-6])
    velocity = np.array([1.0, 0.2, -0.1, 0.1, -0.3, 0.2])
    camera = CameraEstimate(Status(State.TRACKING), T_MAP_CAMERA, covariance, velocity, covariance)
    base = camera.to_base(T_BASE_CAMERA)
    assert base.T_map_base.distance(T_MAP_CAMERA @ T_BASE_CAMERA.inverse())[0] < 1e-12
    xi = rng.multivariate_normal(np.zeros(6), covariance, 20_000)  # errors of the camera, seen at the base
    T_camera_base = T_BASE_CAMERA.inverse()
    seen = (base.T_map_base.inverse() @ T_MAP_CAMERA @ SE3.exp(xi) @ T_camera_base).log()
    np.testing.assert_allclose(np.cov(seen.T), base.covariance, atol=0.04 * np.max(base.covariance))
    dt = 1e-6
    later = T_MAP_CAMERA @ SE3.exp(velocity * dt) @ T_camera_base
    np.testing.assert_allclose((base.T_map_base.inverse() @ later).log() / dt, base.velocity, atol=1e-5)
    assert base.velocity_covariance == pytest.approx(base.covariance)
