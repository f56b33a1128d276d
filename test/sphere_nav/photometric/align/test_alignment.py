"""The result of a registration."""

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.photometric.align import alignment
from sphere_nav.photometric.align.alignment import Alignment


def test_only_a_result_without_a_reason_may_be_used():
    def of(reason):
        return Alignment(SE3.identity(), np.eye(6), reason, 3, 1000, 0.9, 0.8, 2.0, 0.95, (1.0,), (0.0,))

    assert of(alignment.GOOD).is_converged
    for reason in (alignment.LOW_OVERLAP, alignment.LOW_TEXTURE, alignment.NO_CONVERGENCE, alignment.OUTLIERS):
        assert not of(reason).is_converged
