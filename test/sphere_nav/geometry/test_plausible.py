"""Lengths that are no metres are told with the factor."""

import numpy as np
import pytest

from sphere_nav.geometry.plausible import BOUNDS, check_length, check_lengths


def test_a_length_of_another_unit_is_told_with_the_factor():
    for kind, (low, high) in BOUNDS.items():
        check_length(kind, low, "here")
        check_length(kind, high, "here")
        with pytest.raises(ValueError, match=r"here: expected metres, .*\(factor 0.001\)"):
            check_length(kind, 1.01 * high, "here")
    check_lengths("depth", np.array([np.nan, 0.0, np.inf]), "nothing")  # nothing is measured
