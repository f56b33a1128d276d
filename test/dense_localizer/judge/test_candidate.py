"""What is asked of a candidate before anything goes on from it."""

import numpy as np

from dense_localizer.judge.acceptance import refuse
from dense_localizer.judge.candidate import PoseCandidate
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


def test_half_a_meter_is_certain_enough_to_go_on():
    for sigma_m, is_certain in [(0.49, True), (0.51, False)]:
        covariance = np.diag([1e-6, sigma_m**2, 1e-6, 1e-6, 1e-6, 1e-6])
        assert candidate(0.0, refuse(FINE), covariance).is_certain == is_certain
