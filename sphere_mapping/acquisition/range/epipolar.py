"""Two spheres one above the other, whose epipolar lines are columns: disparities, and range from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sphere_mapping.acquisition.constants import BELOW_ZERO_DEG, FAR_M, MAX_BASELINE_ERROR, MAX_SINE, MIN_RANGE_SHARE
from sphere_mapping.acquisition.kernels import recenter, triangulate
from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.matching import Disparity, Search
from sphere_mapping.acquisition.stitching.views import Layout, axes_of
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Floats


def disparities_of_ranges(window: Spherical, baseline_m: float, params: MatchParams) -> Search:
    """Return the disparities, in px, of everything from the nearest range wanted to beyond all."""
    largest = np.arcsin(min(baseline_m / params.nearest_m, MAX_SINE))
    per_radian = window.full_width / (2 * np.pi)
    first_px = -BELOW_ZERO_DEG * window.full_width / 360.0
    return Search(first_px, float(largest) * per_radian, window.is_whole, window.full_width)


def range_from_disparity(
    disparity: Disparity, window: Spherical, baseline_m: float, params: MatchParams
) -> tuple[Floats, Floats]:
    """Return range along the ray from the upper centre and its deviation (H, W) in m, NaN where not trusted."""
    range_m, std_m = np.empty_like(disparity.value), np.empty_like(disparity.value)
    limits = (params.max_relative_std, MIN_RANGE_SHARE * params.nearest_m, FAR_M)
    per_row = 2 * np.pi / window.full_width
    triangulate(disparity.value, disparity.std, per_row, window.offset_v, baseline_m, limits, range_m, std_m)
    return range_m, std_m


def baseline_error(layouts: Sequence[Layout], baseline_m: float) -> Floats:
    """Return by which share (H, W) the baseline of the two cameras that show a direction is longer than that of all.

    layouts: of the top and the bottom level. Cameras are never mounted exactly one above the other: what counts is what
    they are apart at a right angle to the ray, in the plane of ray and baseline.
    """
    top, bottom = layouts
    apart = top.centers[top.owner] - bottom.centers[bottom.owner]  # (H, W, 3); what nobody shows is any camera's
    columns, (sine, cosine) = axes_of(top.owner.shape)
    sine, cosine = sine[:, None], cosine[:, None]
    ahead = apart[..., 0] * columns[1] + apart[..., 1] * columns[0]
    error = (apart[..., 2] * cosine - ahead * sine) / (cosine * baseline_m)
    return np.clip(error, -MAX_BASELINE_ERROR, MAX_BASELINE_ERROR).astype(np.float32)


def joined_share(layout: Layout, per_m: float) -> Floats:
    """Return by which share (H, W) ranges are too large because the images were joined for a distance of 1 / per_m.

    A camera at o shows a pixel p where the sphere's centre would see a point at that distance D: along D p - o, which
    is turned up by (o . e) / D, e being p's derivative by colatitude a. So the colatitude is wrong by as much, and the
    disparity by the share o . p / D: sin(a) / disparity is too large by the horizontal part of o toward p / (D sin(a)).
    """
    columns, rows = axes_of(layout.owner.shape)
    centers = layout.centers[layout.owner]
    level = centers[..., 0] * columns[1] + centers[..., 1] * columns[0]
    return np.clip(per_m * level / rows[1][:, None], -MAX_BASELINE_ERROR, MAX_BASELINE_ERROR).astype(np.float32)


def correct_baseline(range_m: Floats, std_m: Floats, error: Floats, shrink: Floats, per_m: float) -> None:
    """Change range and deviation (H, W) to those from the own centre of the camera that shows each pixel.

    error: of its baseline (`baseline_error`); shrink: 1 / (1 + `joined_share`). The images of both levels were joined
    for a distance of 1 / per_m, where a wrong baseline changes nothing; what is far stays so.
    """
    is_near = np.isfinite(range_m)
    with np.errstate(invalid="ignore"):
        longer = np.maximum(1 + error * np.float32(per_m) * range_m, np.float32(0.1))
        factor = np.where(is_near, (1 + error) / longer * shrink, np.float32(1.0))
    range_m *= factor
    std_m *= factor


def to_common_center(range_m: Floats, std_m: Floats, layout: Layout, per_m: float) -> tuple[Floats, Floats]:
    """Return range and deviation (H, W) as from the sphere's centre; before, from each pixel's own camera.

    per_m: 1 over the distance for which the images were joined.
    """
    moved, moved_std = np.empty_like(range_m), np.empty_like(std_m)
    axes = (axis.astype(np.float32) for axis in axes_of(range_m.shape))
    recenter(range_m, std_m, layout.owner, layout.centers, *axes, np.float32(per_m), moved, moved_std)
    return moved, moved_std
