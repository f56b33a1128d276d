"""A rectified stereo pair -> the partial sphere of its left camera.

Semi-global matching with left-right check gives disparity to about a quarter pixel, biased to whole pixels; steps of
one-dimensional alignment of small blocks (the disparity of every pixel kept, so that slanted ground is no problem)
remove the bias and say how certain each pixel is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3, Pinhole
from sphere_map.sphere import T_BODY_OPTICAL, Image, Sphere, check_image, to_grey
from sphere_mapping.acquisition.partial import full_width_of, resample_image, resample_nearest, resample_range
from sphere_mapping.acquisition.window import window_of
from sphere_mapping.params import PartialParams, StereoParams

Plane = NDArray[np.float32]

HALF_DIFFERENCE, ONE = np.array([-0.5, 0.0, 0.5], np.float32), np.array([1.0], np.float32)
SGBM_SCALE = 16.0  # the matcher's disparities are sixteenths of a pixel
MAX_REFINEMENT = 1.0  # px; a block that wants to go farther from its match is not trusted


@dataclass(frozen=True, eq=False)
class Disparity:
    """Disparity of each left pixel (H, W) and its standard deviation, in pixels; NaN where not trusted."""

    value: Plane
    std: Plane


def sphere_from_stereo(
    left: Image,
    right: Image,
    camera: Pinhole,
    baseline_m: float,
    T_sphere_camera: SE3 = T_BODY_OPTICAL,
    stamp_ns: int = 0,
    params: StereoParams | None = None,
    partial: PartialParams | None = None,
) -> Sphere:
    """Return the partial sphere of a rectified pair; the right camera is `baseline_m` to the right of the left one."""
    params, partial = params or StereoParams(), partial or PartialParams()
    depth_m, relative_std = depth_from_stereo(left, right, camera, baseline_m, params)
    window = window_of(camera, T_sphere_camera, full_width_of([camera], partial), partial.num_levels)
    range_m = resample_range(depth_m, camera, T_sphere_camera, window, partial)
    image, weight = resample_image(left, camera, T_sphere_camera, window, range_m)
    range_m[weight == 0] = np.nan
    range_std_m = range_m * resample_nearest(relative_std, camera, T_sphere_camera, window)
    return Sphere(image, range_m, window, stamp_ns, range_std_m)


def depth_from_stereo(
    left: Image, right: Image, camera: Pinhole, baseline_m: float, params: StereoParams
) -> tuple[Plane, Plane]:
    """Return depth along z (H, W) in metres, NaN where not trusted, and its relative standard deviation (H, W)."""
    check_image(left, camera, "left image")
    check_image(right, camera, "right image")
    if camera.is_distorted:
        raise ValueError(f"stereo camera: expected rectified images (no distortion), found {camera.distortion}")
    if not (np.isfinite(baseline_m) and baseline_m > 0):
        raise ValueError(f"stereo baseline: expected positive metres, found {baseline_m}")
    disparity = match(left, right, params)
    too_small = ~(disparity.value >= params.min_disparity_px)
    relative_std = disparity.std / np.where(too_small, np.nan, disparity.value)
    depth_m = camera.fx * baseline_m / np.where(relative_std <= params.max_relative_std, disparity.value, np.nan)
    return depth_m.astype(np.float32), relative_std.astype(np.float32)


def match(left: Image, right: Image, params: StereoParams) -> Disparity:
    """Return the disparity of every pixel of the left image of a rectified pair (H, W[, 3]) uint8."""
    grey_left, grey_right = to_grey(left), to_grey(right)
    coarse = _match_semi_globally(_to_uint8(grey_left), _to_uint8(grey_right), params)
    return _refine(grey_left, grey_right, coarse, params)


def _match_semi_globally(left: Image, right: Image, params: StereoParams) -> Plane:
    """Return the checked disparity (H, W), NaN where left and right disagree, on islands and without a clear best."""
    area = params.block_size**2
    matcher = cv2.StereoSGBM_create(
        minDisparity=0,
        numDisparities=16 * ((params.num_disparities + 15) // 16),
        blockSize=params.block_size,
        P1=int(params.smoothness * area),
        P2=int(params.jump_penalty * area),
        disp12MaxDiff=params.max_left_right_px,
        preFilterCap=31,
        uniquenessRatio=params.uniqueness,
        speckleWindowSize=params.speckle_size,
        speckleRange=params.speckle_range,
        mode=cv2.STEREO_SGBM_MODE_SGBM,  # one thread, so the same bits every time
    )
    margin = matcher.getNumDisparities()  # without it the matcher leaves as many columns empty at the left
    padded = [cv2.copyMakeBorder(image, 0, 0, margin, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    raw = matcher.compute(*padded)[:, margin:]
    columns = np.arange(raw.shape[1], dtype=np.float32)
    disparity = raw.astype(np.float32) / SGBM_SCALE
    disparity[(raw < 0) | (columns - disparity < 0)] = np.nan  # no match, or outside the right image
    return disparity


def _refine(left: Plane, right: Plane, disparity: Plane, params: StereoParams) -> Disparity:
    """Align blocks of the left image with the right one along the row, starting from the matched disparity.

    The shift of a block minimises the squared grey-level difference beside a constant (cameras expose differently);
    with noise of variance s^2 in both images its variance is 2 s^2 / sum of squared gradients. What the rectification
    leaves comes on top.
    """
    known = ~np.isnan(disparity)
    refined = np.where(known, disparity, 0).astype(np.float32)
    side = (2 * params.refine_radius + 1,) * 2
    v, u = np.mgrid[0 : left.shape[0], 0 : left.shape[1]].astype(np.float32)
    slope_left, slope_right = _slope(left), _slope(right)
    curvature = np.ones_like(left)
    for _ in range(max(params.refine_steps, 1)):
        seen = cv2.remap(right, u - refined, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        slope = 0.5 * (slope_left + cv2.remap(slope_right, u - refined, v, cv2.INTER_LINEAR))
        step, curvature = _block_step(slope, seen - left, known, side)
        if params.refine_steps:
            refined += np.where(known, np.clip(step, -0.5, 0.5), 0).astype(np.float32)
    std = np.sqrt(2 * params.noise**2 / np.maximum(curvature, 1e-3) + params.calibration_px**2).astype(np.float32)
    strayed = ~(np.abs(refined - disparity) <= MAX_REFINEMENT)
    return Disparity(np.where(strayed, np.nan, refined), np.where(strayed, np.nan, std))


def _block_step(
    slope: Plane, difference: Plane, known: NDArray[np.bool_], side: tuple[int, int]
) -> tuple[Plane, Plane]:
    """Return the shift that explains the differences of each block best beside a constant, and its curvature."""

    def mean(values: Plane) -> Plane:
        return cv2.boxFilter(np.where(known, values, 0), -1, side) * per_known

    per_known = 1 / np.maximum(cv2.boxFilter(known.astype(np.float32), -1, side), 1e-3)
    mean_slope, mean_difference = mean(slope), mean(difference)
    curvature = mean(slope * slope) - mean_slope**2
    step = (mean(slope * difference) - mean_slope * mean_difference) / np.maximum(curvature, 1e-3)
    return step, curvature * (side[0] * side[1]) / per_known


def _slope(image: Plane) -> Plane:
    """Return the derivative along the row in grey levels per pixel."""
    return cv2.sepFilter2D(image, -1, HALF_DIFFERENCE, ONE)


def _to_uint8(grey: Plane) -> Image:
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
