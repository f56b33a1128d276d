"""Two spheres one above the other, whose epipolar lines are columns: disparities, and range from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import BELOW_ZERO_DEG, FAR_M, MAX_SINE, MIN_RANGE_SHARE
from sphere_mapping.acquisition.kernels import recenter, triangulate
from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.matching import Disparity, Search
from sphere_mapping.acquisition.stitching.views import axes_of
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Floats

Shown = tuple[NDArray[np.int8], Floats]  # which camera shows a pixel (H, W), -1 none; where they stand (N, 3) in m


def disparities_of_ranges(window: Spherical, baseline_m: float, params: MatchParams) -> Search:
    """Return the disparities, in px, of everything from the nearest range wanted to beyond all."""
    largest = np.arcsin(min(baseline_m / params.nearest_m, MAX_SINE))
    per_radian = window.full_width / (2 * np.pi)
    first_px = -BELOW_ZERO_DEG * window.full_width / 360.0
    return Search(first_px, float(largest) * per_radian, window.is_whole, window.full_width)


def range_from_disparity(
    disparity: Disparity,
    baseline_m: float,
    params: MatchParams,
    shown: tuple[Shown, Shown] | None = None,
    per_m: float = 0.0,
) -> tuple[Floats, Floats]:
    """Return range from the centre of the upper sphere and its deviation (H, W) in m, NaN where not trusted.

    shown: by which cameras, of the upper and the lower sphere; they are never mounted exactly in their centres; None:
    they are. per_m: 1 over the distance for which their images were joined. Ranges are those of what the pixels show.
    """
    range_m, std_m = np.empty_like(disparity.value), np.empty_like(disparity.value)
    limits = tuple(map(np.float32, (params.max_relative_std, MIN_RANGE_SHARE * params.nearest_m, FAR_M)))
    axes, centered = axes_of(range_m.shape), (np.zeros(range_m.shape, np.int8), np.zeros((1, 3), np.float32))
    shown = shown or (centered, centered)
    lengths = np.float32(baseline_m), np.float32(per_m)
    triangulate(disparity.value, disparity.std, axes, shown, *lengths, limits, range_m, std_m)
    return range_m, std_m


def in_own_directions(range_m: Floats, std_m: Floats, shown: Shown, per_m: float) -> tuple[Floats, Floats]:
    """Return range and deviation (H, W) from the sphere's centre in the pixels' own directions.

    per_m: 1 over the distance for which the images were joined; what is elsewhere, pixels show beside its direction.
    """
    moved, moved_std = np.empty_like(range_m), np.empty_like(std_m)
    recenter(range_m, std_m, *shown, *axes_of(range_m.shape), np.float32(per_m), moved, moved_std)
    return moved, moved_std
