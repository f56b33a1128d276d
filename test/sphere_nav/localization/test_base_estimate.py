"""A status alone is an estimate without a pose."""

from sphere_nav.localization.status import BaseEstimate, State, Status


def test_without_trust_there_is_no_pose():
    estimate = BaseEstimate(Status(State.SEARCHING))
    assert (estimate.T_map_base, estimate.covariance, estimate.velocity, estimate.velocity_covariance) == (None,) * 4
