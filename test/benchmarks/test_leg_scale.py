"""Scale of a leg: signed, and apart from what lies beside it."""

import numpy as np
import pytest

from benchmarks.leg_scale import compare


@pytest.mark.parametrize("scale", [-0.3, 0.05])
def test_scale_has_a_sign_and_a_bend_is_not_scale(scale):
    true = np.array([30.0, 40.0, 0.0])
    found = (1.0 + scale / 100.0) * true
    assert compare(found, true) == pytest.approx((scale, 0.0), abs=1e-9)
    turned = compare(found + 0.05 * np.array([-0.8, 0.6, 0.0]), true)
    assert turned[0] == pytest.approx(scale, abs=1e-4)
    assert turned[1] == pytest.approx(50.0, abs=1e-6)
