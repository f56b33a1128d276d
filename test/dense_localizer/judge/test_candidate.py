"""What is made of candidates: the first that is accepted, no more than needed; refused ones keep what they are."""

import numpy as np
import pytest

from dense_localizer.judge.acceptance import Acceptance, refuse
from dense_localizer.judge.candidate import PoseCandidate, select_first_accepted
from dense_localizer.motion_prior import Prediction
from dense_localizer.references.reference import Choice
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Reason, Verdict

NOTHING_CHOSEN = Choice((), (), 0.0, np.inf, np.inf, np.inf)
LOST_SIGHT = Verdict(Reason.LOW_OVERLAP, 0.1, 0.25)


def candidate(x, acceptance, covariance=None):
    pose = SE3.from_planar(x, 0.0, 0.0)
    covariance = 1e-6 * np.eye(6) if covariance is None else covariance
    return PoseCandidate(pose, covariance, Prediction.guess(pose), NOTHING_CHOSEN, acceptance)


def test_the_first_accepted_candidate_ends_the_attempts():
    accepted = Acceptance(is_accepted=True, is_good=True, finding=FINE, quality=1.0)
    made = []

    def make(*acceptances):
        for number, acceptance in enumerate(acceptances):
            made.append(number)
            yield candidate(number, acceptance)

    refused = refuse(LOST_SIGHT)
    assert select_first_accepted(make(refused, accepted, accepted)).T_map_camera.translation[0] == 1.0
    assert made == [0, 1]
    assert select_first_accepted(make(refused, refused)).T_map_camera.translation[0] == 0.0
    with pytest.raises(ValueError, match="found none"):
        select_first_accepted([])


def test_half_a_meter_is_certain_enough_to_go_on():
    for sigma_m, is_certain in [(0.49, True), (0.51, False)]:
        covariance = np.diag([1e-6, sigma_m**2, 1e-6, 1e-6, 1e-6, 1e-6])
        assert candidate(0.0, refuse(FINE), covariance).is_certain == is_certain
