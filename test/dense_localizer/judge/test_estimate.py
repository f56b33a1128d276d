"""From the camera to the base: pose, covariance and velocity of one rigid body."""

import numpy as np
import pytest

from dense_localizer.judge.estimate import CameraEstimate, report_estimate
from dense_localizer.judge.lens_watch import LensWatch
from dense_localizer.motion_prior import PosePrior
from dense_localizer.params import PriorParams
from sphere_nav.geometry import SE3
from sphere_nav.localization.params import StateParams
from sphere_nav.localization.state_machine import StateMachine
from sphere_nav.localization.status import FINE, Reason, State, Status, Verdict
from sphere_nav.photometric.checks.lens import Stretch

T_BASE_CAMERA = SE3.exp([0.5, 0.1, 1.2, -0.3, 0.2, 1.1])
T_MAP_CAMERA = SE3.exp([3.0, 1.0, 1.0, 0.1, -0.2, 0.7])


def test_a_vehicle_with_a_wrong_lens_is_as_unsure_of_its_place_as_that_makes_it():
    states, lens, prior = StateMachine(StateParams()), LensWatch(), PosePrior(PriorParams())
    states.state = State.TRACKING
    prior.start(T_MAP_CAMERA, np.eye(6), 1)
    lens.add([Stretch("", 0.2, 0.003, np.ones(6))], 1)
    told = report_estimate(states, prior, 1, FINE, None, lens)
    np.testing.assert_allclose(told.covariance, np.eye(6) + 0.04, rtol=0.01)


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


@pytest.mark.parametrize(
    ("is_wrong", "found", "told"),
    [
        (True, Reason.LOW_OVERLAP, Reason.BAD_INFO),
        (False, Reason.LOW_OVERLAP, Reason.LOW_OVERLAP),
        (True, Reason.AMBIGUOUS, Reason.AMBIGUOUS),
    ],
)
def test_a_search_in_which_nothing_resembles_the_view_names_a_wrong_lens(is_wrong, found, told):
    states, lens = StateMachine(StateParams()), LensWatch()
    states.search()
    if is_wrong:
        lens.add([Stretch("", 0.2, 0.003, np.ones(6))], 1)
    estimate = report_estimate(states, PosePrior(PriorParams()), 1, Verdict(found), None, lens)
    assert estimate.status.reason == told
