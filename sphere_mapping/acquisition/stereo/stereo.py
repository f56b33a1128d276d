"""A rectified stereo pair -> the partial sphere of its left camera. Turned by 90 deg it is matched as spheres are."""

from __future__ import annotations

import numpy as np

from sphere_mapping.acquisition.constants import MAX_WIDTH_SHARE, RECTIFIED_PX
from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, sphere_from_view
from sphere_mapping.acquisition.range.matching import Disparity, Search, match_columns
from sphere_mapping.acquisition.range.semi_global import check_order
from sphere_mapping.params import PartialParams, StereoParams
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Bytes, Flags, Floats
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere, check_sphere_image, to_gray_bytes


def sphere_from_stereo(
    left: Bytes,
    right: Bytes,
    camera: Pinhole,
    baseline_m: float,
    T_sphere_camera: SE3 = T_BODY_OPTICAL,
    stamp_ns: int = 0,
    params: StereoParams | None = None,
    partial: PartialParams | None = None,
    is_seen: Flags | None = None,
) -> Sphere:
    """Return the partial sphere of a rectified pair; the right camera is `baseline_m` to the right of the left one.

    is_seen (H, W): where the left image shows something; None: everywhere.
    """
    depth_m, relative_std = depth_from_stereo(left, right, camera, baseline_m, params or StereoParams())
    if is_seen is not None:
        depth_m[~is_seen] = np.nan
        left = np.where(is_seen if left.ndim == 2 else is_seen[..., None], left, 0).astype(np.uint8)
    view = RgbdView(left, depth_m, camera, T_sphere_camera, relative_std=relative_std)
    return sphere_from_view(view, stamp_ns, partial)


def depth_from_stereo(
    left: Bytes, right: Bytes, camera: Pinhole, baseline_m: float, params: StereoParams
) -> tuple[Floats, Floats]:
    """Return depth along z (H, W) in metres, NaN where not trusted, and its relative standard deviation (H, W)."""
    check_sphere_image(left, camera, "left image")
    check_sphere_image(right, camera, "right image")
    if not (np.isfinite(baseline_m) and baseline_m > 0):
        raise ValueError(f"stereo baseline: expected positive metres, found {baseline_m}")
    disparity = match_pair(left, right, disparities_of_depths(camera, baseline_m, params), params)
    too_small = ~(disparity.value >= RECTIFIED_PX)
    relative_std = disparity.std / np.where(too_small, np.nan, disparity.value)
    depth_m = camera.fx * baseline_m / np.where(relative_std <= params.max_relative_std, disparity.value, np.nan)
    return depth_m.astype(np.float32), relative_std.astype(np.float32)


def match_pair(left: Bytes, right: Bytes, search: Search, params: StereoParams) -> Disparity:
    """Return the disparity of every pixel of the left image of a rectified pair (H, W[, 3]) uint8."""
    top, bottom = (np.ascontiguousarray(to_gray_bytes(image).T) for image in (left, right))  # rows become columns
    check_order(top, bottom, ("left", "right"), is_whole=False)
    found = match_columns(top, bottom, search, params, np.ones(top.shape, np.bool_))
    return Disparity(np.ascontiguousarray(found.value.T), np.ascontiguousarray(found.std.T))


def disparities_of_depths(camera: Pinhole, baseline_m: float, params: StereoParams) -> Search:
    """Return the disparities from the nearest depth wanted, as far as half the image goes, to below 0."""
    nearest = camera.fx * baseline_m / params.nearest_m
    return Search(-RECTIFIED_PX, min(nearest, MAX_WIDTH_SHARE * camera.width))
