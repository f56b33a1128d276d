"""Ranges of several sources in one sphere, joined by their variance; a LiDAR's cloud as a source."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sphere_geometry import Spherical
from sphere_mapping.stitching.kernels import splat_with_std
from sphere_mapping.stitching.params import FusionParams

Plane = NDArray[np.float32]
Ranged = tuple[Plane, Plane]  # range and its standard deviation (H, W) in m; NaN unknown, range +Inf known to be far


def fused(sources: Sequence[Ranged], params: FusionParams) -> Ranged:
    """Return the mean by inverse variance of what agrees with the surest source of each pixel."""
    if not sources:
        raise ValueError("range: expected at least one source, found none")
    if len(sources) == 1:
        return sources[0]
    ranges, stds = (np.stack([source[k] for source in sources]) for k in range(2))
    known = np.isfinite(ranges) & (stds > 0)
    relative = np.where(known, stds / np.where(known, ranges, 1.0), np.inf)
    surest = np.argmin(relative, axis=0)[None]
    best, best_std = (np.take_along_axis(planes, surest, axis=0) for planes in (ranges, stds))
    with np.errstate(invalid="ignore", divide="ignore"):
        agrees = known & (np.abs(ranges - best) <= params.max_deviations * np.hypot(stds, best_std))
        weights = np.where(agrees, 1.0 / np.square(stds), 0.0)
        total = weights.sum(axis=0)
        range_m = np.where(total > 0, np.sum(weights * np.where(agrees, ranges, 0.0), axis=0) / total, np.nan)
        std_m = np.where(total > 0, 1.0 / np.sqrt(total), np.nan)
    is_far = np.isinf(ranges).any(axis=0) & (total == 0)
    range_m[is_far] = np.inf
    return range_m.astype(np.float32), std_m.astype(np.float32)


def range_from_cloud(points_sphere: NDArray[np.floating], whole: Spherical, params: FusionParams) -> Ranged:
    """Return the range of points (N, 3) in the sphere's frame; the nearest hides the others."""
    points = np.asarray(points_sphere, dtype=np.float64)
    points = points[np.all(np.isfinite(points), axis=1) & (np.abs(points).max(axis=1, initial=0.0) > 0)]
    stds = np.full(len(points), params.cloud_std_m, np.float32)
    return splatted(points, stds, whole, params.cloud_size_px)


def splatted(points: NDArray[np.float64], stds: Plane, whole: Spherical, half_px: int = 0) -> Ranged:
    """Return the nearest range at each pixel of a sphere, of points (N, 3) in its frame."""
    nearest = np.full((whole.height, whole.width), np.inf, np.float32)
    nearest_std = np.full(nearest.shape, np.nan, np.float32)
    u, v = (np.ascontiguousarray(values, dtype=np.float32) for values in whole.project(points)[0].reshape(-1, 2).T)
    ranges = np.linalg.norm(points, axis=-1).astype(np.float32)
    splat_with_std(u, v, ranges, stds, half_px, True, nearest, nearest_std)
    nearest[np.isinf(nearest)] = np.nan
    return nearest, nearest_std
