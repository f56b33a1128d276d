"""Compiling before the first image, under any parameters that are allowed."""

from __future__ import annotations

import pytest

from mcl_depth.belief import kernels as belief
from mcl_depth.geometry import kernels as geometry
from mcl_depth.geometry.columns import kernels as columns
from mcl_depth.likeness import kernels as likeness
from mcl_depth.params import FilterParams
from mcl_depth.warm_up import warm_up
from sphere_nav.params import build


NOT_OF_IMAGES = {"mcl_depth.geometry.kernels.decompress_lzf"}  # of a file that is read before


@pytest.mark.parametrize("step", [1.0, 10.0, 90.0])
def test_every_step_of_headings_can_be_warmed_up(step):
    warm_up(build(FilterParams, {"heading_step_deg": step}))
    missing = {
        f"{module.__name__}.{name}"
        for module in (belief, geometry, columns, likeness)
        for name, kernel in vars(module).items()
        if not name.startswith("_") and hasattr(kernel, "signatures") and not kernel.signatures
    }
    assert missing <= NOT_OF_IMAGES


def test_a_step_that_does_not_divide_the_circle_is_refused():
    with pytest.raises(ValueError, match="divisor of 360"):
        warm_up(build(FilterParams, {"heading_step_deg": 7.0}))
