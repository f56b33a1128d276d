"""What is asked of a candidate before anything goes on from it."""

import numpy as np

from dense_localizer.judge.acceptance import refuse
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.motion_prior import Prediction
from dense_localizer.references.reference import Choice
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE

HERE, NOTHING_CHOSEN = SE3.identity(), Choice((), (), 0.0, np.inf, np.inf, np.inf)


def test_half_a_meter_is_certain_enough_to_go_on():
    for sigma_m, is_certain in [(0.49, True), (0.51, False)]:
        covariance = np.diag([1e-6, sigma_m**2, 1e-6, 1e-6, 1e-6, 1e-6])
        found = PoseCandidate(HERE, covariance, Prediction.guess(HERE), NOTHING_CHOSEN, refuse(FINE))
        assert found.is_certain == is_certain
