"""Compile the kernels before the first image waits for them."""

from __future__ import annotations

import numpy as np

from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.image_params import SynthesisParams
from mcl_depth.likeness.comparison import depth_features_many, num_alpha_for, similarity_many, visual_features
from mcl_depth.params import FilterParams


def warm_up(params: FilterParams) -> None:
    """Run every kernel once on a few points, as the parameters ask for."""
    num_headings = num_alpha_for(params.heading_step_deg)
    rng = np.random.default_rng(0)
    cloud = cloud_from_points(rng.uniform(-1.0, 1.0, (200, 3)))
    for drawing in ("columns", "splats"):
        columns = num_headings * -(-64 // num_headings)
        synthesizer = DepthSynthesizer(cloud, SynthesisParams(num_columns=columns), drawing)
        ranges = synthesizer.synthesize_many(np.zeros((2, 3)))
    grey = rng.uniform(0, 255, ranges.shape[1:]).astype(np.float32)
    for is_seen in (None, grey > 10.0):
        visual = visual_features(grey, is_seen)
        similarity_many(visual, depth_features_many(ranges, params.comparison), num_headings)
