"""Compiling before the first image, under any parameters that are allowed."""

from __future__ import annotations

import pytest

from mcl_depth.geometry import kernels as geometry
from mcl_depth.likeness import kernels as likeness
from mcl_depth.params import FilterParams
from mcl_depth.warm_up import warm_up
from sphere_nav.params import build

KERNELS = (  # that an image, or a panorama that it is compared with, goes through
    likeness.visual_gradients, likeness.encode_depth_many, likeness.compare_headings_many,
    likeness.correlate_codes, geometry.draw_many,
)  # fmt: skip


@pytest.mark.slow
def test_every_step_of_headings_can_be_warmed_up():
    warm_up(build(FilterParams, {"heading_step_deg": 10.0}))
    assert [kernel.__name__ for kernel in KERNELS if not kernel.signatures] == []
