"""Compile the kernels before the first image waits for them."""

from __future__ import annotations

from functools import cache

import numpy as np

from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.kernels import decompress_lzf
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.gradients import Gradients
from mcl_depth.params import FilterParams, SynthesisParams
from sphere_nav import photometric


@cache
def warm_up(params: FilterParams) -> None:
    """Run every kernel once on a few points, as the parameters ask for."""
    num_headings = params.num_headings
    rng = np.random.default_rng(0)
    cloud = cloud_from_points(rng.uniform(-1.0, 1.0, (200, 3)))
    columns = num_headings * -(-64 // num_headings)
    ranges = DepthSynthesizer(cloud, SynthesisParams(num_columns=columns)).synthesize_many(np.zeros((2, 3)))
    gray = rng.uniform(0, 255, ranges.shape[1:]).astype(np.float32)
    likeness, slots = Gradients(params.comparison), np.arange(len(ranges))
    stack, visual = likeness.depths(ranges), likeness.image(gray)
    likeness.compare(visual, stack, slots, num_headings)
    likeness.survey(visual, stack, slots, num_headings)
    decompress_lzf(np.frombuffer(bytes(2), np.uint8), np.empty(1, np.uint8))  # as of a file
    photometric.warm_up()
