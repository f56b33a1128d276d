"""Compiling before the first image, under any parameters that are allowed."""

from __future__ import annotations

import pytest

from mcl_depth.params import FilterParams
from mcl_depth.warm_up import warm_up
from sphere_nav.params import build


@pytest.mark.parametrize("step", [1.0, 10.0, 90.0])
def test_every_step_of_headings_can_be_warmed_up(step):
    warm_up(build(FilterParams, {"heading_step_deg": step}))


def test_a_step_that_does_not_divide_the_circle_is_refused():
    with pytest.raises(ValueError, match="divisor of 360"):
        warm_up(build(FilterParams, {"heading_step_deg": 7.0}))
