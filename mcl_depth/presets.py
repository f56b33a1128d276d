"""Surroundings and the values that suit them: with these all figures are measured."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcl_depth.params import FilterParams
from sphere_nav.params import build, to_mapping

INDOOR_WIDTH_M = 40.0  # a building is narrower, if not shorter

PRESETS: dict[str, dict[str, Any]] = {
    "indoor": {},  # the defaults
    "outdoor": {
        "cache.max_distance": 0.5,  # what is seen is farther away (N17 table I, column ETHZ)
        "area.step": 0.5,
        "synthesis.voxel_m": 0.2,
        "comparison.is_sky_far": True,  # the skyline is the strongest edge
    },
}


def apply_preset(params: FilterParams, box: tuple[NDArray[Any], NDArray[Any]]) -> FilterParams:
    """Return parameters with the preset's values where they are at their defaults; `box` is that of the cloud, m."""
    name = params.preset
    if name == "auto":
        width = float(np.min((box[1] - box[0])[:2]))
        name = "indoor" if width <= INDOOR_WIDTH_M else "outdoor"
    values, defaults = to_mapping(params), to_mapping(type(params)())
    changes = {key: value for key, value in PRESETS[name].items() if values[key] == defaults[key]}
    return build(type(params), values | changes | {"preset": name})
