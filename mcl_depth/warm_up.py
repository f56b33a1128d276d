"""Compile the kernels before the first image waits for them."""

from __future__ import annotations

from functools import cache

import numpy as np

from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.kernels import decompress_lzf
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.comparison import compare_gradients, num_alpha_for
from mcl_depth.likeness.features import depth_features_many, visual_features
from mcl_depth.likeness.gradient_filter import GradientFilter
from mcl_depth.params import FilterParams, SynthesisParams
from sphere_nav import photometric


@cache
def warm_up(params: FilterParams) -> None:
    """Run every kernel once on a few points, as the parameters ask for."""
    num_headings = num_alpha_for(params.heading_step_deg)
    rng = np.random.default_rng(0)
    cloud = cloud_from_points(rng.uniform(-1.0, 1.0, (200, 3)))
    columns = num_headings * -(-64 // num_headings)
    ranges = DepthSynthesizer(cloud, SynthesisParams(num_columns=columns)).synthesize_many(np.zeros((2, 3)))
    gray = rng.uniform(0, 255, ranges.shape[1:]).astype(np.float32)
    stack = depth_features_many(ranges, params.comparison)
    for is_seen in (True, gray > 10.0):
        compare_gradients(visual_features(gray, is_seen), stack, np.arange(len(stack)), num_headings)
    GradientFilter.of(stack, np.arange(len(stack))).curves(visual_features(gray), num_headings)
    decompress_lzf(np.frombuffer(bytes(2), np.uint8), np.empty(1, np.uint8))  # as of a file
    photometric.warm_up()
