"""Ranges of several sources in one sphere, joined by their variance; a LiDAR's cloud and RGB-D as sources."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    CLOUD_STD_M,
    CONTRADICTION,
    MIN_KNOWN,
    PATCH_PX,
    STEEP,
)
from sphere_mapping.acquisition.params import FusionParams
from sphere_mapping.acquisition.partial.depth_registration import draw_nearest
from sphere_mapping.acquisition.partial.partial_sphere import resample_range
from sphere_mapping.acquisition.partial.window import place_in, window_of
from sphere_mapping.acquisition.range.levels import around
from sphere_mapping.acquisition.stitching.views import RigView
from sphere_nav.estimation.least_squares import gate
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Flags, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays

Ranged = tuple[Floats, Floats]  # range and its standard deviation (H, W) in m; NaN unknown, range +Inf known to be far


def fuse_sources(sources: Sequence[Ranged], whole: Spherical) -> Ranged:
    """Return the mean (H, W) by inverse variance of what agrees with the surest source of each pixel.

    Where others, about as sure, contradict it, nothing is known; nor without a source.
    """
    if not sources:
        shape = (whole.height, whole.width)
        return np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    if len(sources) == 1:
        return sources[0]
    ranges, stds = (np.stack([source[k] for source in sources]) for k in range(2))
    is_usable, (surer, share) = (stds > 0) & np.isfinite(ranges), CONTRADICTION
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(is_usable, stds / ranges, np.float32(np.inf))
        surest = np.argmin(relative, axis=0)[None]
        best, best_std = (np.take_along_axis(planes, surest, axis=0) for planes in (ranges, stds))
        off = np.abs(ranges - best)
        agrees = is_usable & (off * off <= np.float32(gate(1)) * (stds * stds + best_std * best_std))
        denies = is_usable & ~agrees & (relative < surer * relative.min(axis=0)) & (off > share * best)
        weights = np.where(agrees, 1 / np.square(stds), np.float32(0.0))
        total = weights.sum(axis=0)
        mean = np.where(agrees, weights * ranges, np.float32(0.0)).sum(axis=0) / total
        std_m = 1 / np.sqrt(total)
    unknown = np.where(np.isposinf(ranges).any(axis=0) & ~is_usable.any(axis=0), np.float32(np.inf), np.float32(np.nan))
    is_known = (total > 0) & ~denies.any(axis=0)
    return np.where(is_known, mean, unknown), np.where(is_known, std_m, np.float32(np.nan))


def inverse_range(range_m: Floats, is_covered: Flags) -> Floats | None:
    """Return 1 / range (H, W) everywhere, from known pixels around where unknown; None where too little is known."""
    known = ~np.isnan(range_m)
    share = np.count_nonzero(known) / max(int(np.count_nonzero(is_covered)), 1)
    if not known.any() or share < MIN_KNOWN:
        return None
    with np.errstate(divide="ignore"):
        inverse = fill((1.0 / range_m).astype(np.float32), known)
    return cv2.medianBlur(inverse, 5)


def fill(values: Floats, known: Flags) -> Floats:
    """Return the values (H, W) of a whole sphere, unknown ones from known ones around them, however far; no seam.

    Means of ever larger squares, interpolated: between the rings of a LiDAR an inverse range goes on as a plane's does.
    """
    if known.all() or not known.any():
        return values
    return _spread(np.where(known, values, np.float32(0.0)), known.astype(np.float32))


def _spread(sums: Floats, weights: Floats) -> Floats:
    """Return sums by weights (H, W); where the weight is 0, that of pixels twice as large, between their middles."""
    means, (height, width) = sums / np.maximum(weights, np.float32(1e-6)), weights.shape
    if weights.min() > 0 or min(height, width) < 2:
        return np.where(weights > 0, means, sums.sum() / weights.sum())
    size = (width // 2, height // 2)
    coarser = _spread(*(cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in (sums, weights)))
    padded = around(coarser, 2, is_whole=True)
    finer = cv2.resize(padded, (2 * padded.shape[1], height))[:, 4 : 4 + width]
    return np.where(weights > 0, means, finer)


def range_from_cloud(points_sphere: NDArray[np.floating], whole: Spherical) -> Ranged:
    """Return the range of points (N, 3) in the sphere's frame; the nearest hides the others."""
    points = np.asarray(points_sphere, dtype=np.float64)
    points = points[np.all(np.isfinite(points), axis=1) & (np.abs(points).max(axis=1, initial=0.0) > 0)]
    nearest = draw_nearest(points, whole, PATCH_PX)
    is_known = np.isfinite(nearest)
    nothing = np.float32(np.nan)
    return np.where(is_known, nearest, nothing), np.where(is_known, np.float32(CLOUD_STD_M), nothing)


def range_from_depth(
    depth_m: NDArray[np.floating], rig_view: RigView, whole: Spherical, params: FusionParams
) -> Ranged:
    """Return the range that an RGB-D camera gives the sphere; depth_m (h, w) along its axis, NaN where unknown.

    The deviation grows with the square of the depth, as that of triangulation does.
    """
    camera, T = rig_view.camera, rig_view.T_sphere_camera
    window = window_of(camera, T, whole.width)
    part = resample_range(np.where(depth_m <= params.max_depth_m, depth_m, np.nan), camera, T, window)
    ahead = T.inverse().apply(pixel_rays(window) * part[..., None])[..., 2]
    part[ahead < STEEP * part] = np.nan  # depth along the axis says little there
    std = params.depth_std_m * ahead * part
    range_m, std_m = (np.full((whole.height, whole.width), np.nan, np.float32) for _ in range(2))
    range_m[place_in(window, whole)], std_m[place_in(window, whole)] = part, std
    return range_m, std_m
