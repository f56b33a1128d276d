"""Two images whose epipolar lines are columns -> disparity: whole spheres, which wrap around, or windows.

Semi-global matching (Hirschmueller 2008) with left-right check at moderate resolution gives disparity to about a
quarter pixel, biased to whole pixels; steps of one-dimensional alignment of small blocks at full resolution (the
disparity of every pixel kept, so that slanted ground is no problem) remove the bias and say how certain each pixel is.
A point is higher in the lower image: its row there is v - disparity.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_geometry import Spherical
from sphere_mapping.acquisition.kernels import align_along_columns, smooth
from sphere_mapping.acquisition.params import MatchParams

Plane = NDArray[np.float32]
Image = NDArray[np.uint8]

SGBM_SCALE = 16.0  # the matcher's disparities are sixteenths of a pixel
AROUND = 32  # columns beyond the seam that the matcher sees, so that it knows no seam
NUM_STRIPS = 2  # of a whole sphere, whatever the number of threads, so that the result does not depend on it
SMOOTH_LIMIT, SMOOTH_SHARE = 1.0, 0.03  # px, and by the disparity: neighbours that differ more are not averaged
STEP_LIMIT = 0.5  # px, largest step of the refinement
MIN_BLOCK_SHARE = 0.2  # of a block's pixels must have a match
MAX_REFINEMENT = 1.6  # px; a block that wants to go farther from its match is not trusted
UNKNOWN_PX = 1e4  # stands for unknown where the largest or least is looked for
SATURATION = 31  # preFilterCap of the matcher


@dataclass(frozen=True, eq=False)
class Disparity:
    """Rows by which a pixel of the upper image moves up in the lower one, and its deviation, px; NaN unknown."""

    value: Plane
    std: Plane


def match_columns(
    top: Image, bottom: Image, window: Spherical, params: MatchParams, is_usable: NDArray[np.bool_], jobs: int = 1
) -> Disparity:
    """Return the disparity (H, W) of the upper image; both are (H, W) grey, `is_usable` where both show something."""
    halvings = max(int(np.ceil(np.log2(window.full_width / params.match_width))), 0)
    small = [_shrunk(image, halvings, window.is_whole) for image in (top, bottom)]
    coarse = _smoothed_around(match_semi_globally(small[0], small[1], window, params, jobs), params, window.is_whole)
    coarse[_at_jumps(coarse, params, is_whole=window.is_whole)] = np.nan
    for _ in range(halvings):
        coarse = 2 * np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)
    coarse = coarse[: top.shape[0], : top.shape[1]]
    if coarse.shape != top.shape:
        missing = [(0, side - found) for side, found in zip(top.shape, coarse.shape, strict=True)]
        coarse = np.pad(coarse, missing, constant_values=np.nan)
    coarse[~is_usable] = np.nan
    return refine(top, bottom, coarse, params, is_whole=window.is_whole, jobs=jobs)


def match_semi_globally(top: Image, bottom: Image, window: Spherical, params: MatchParams, jobs: int = 1) -> Plane:
    """Return the checked disparity (H, W), NaN where both directions disagree, on islands and without a clear best."""
    scale = top.shape[1] / window.width * window.full_width / 360.0  # px of a degree
    first = int(np.floor(params.min_disparity_deg * scale))
    count = 16 * int(np.ceil((params.max_disparity_deg * scale - first) / 16))
    across = [np.ascontiguousarray(image.T) for image in (top, bottom)]  # columns become the matcher's rows
    border = cv2.BORDER_WRAP if window.is_whole else cv2.BORDER_REPLICATE
    margin = count + first
    around, number = (AROUND, NUM_STRIPS) if window.is_whole else (0, 1)
    padded = [cv2.copyMakeBorder(image, around, around, 0, 0, border) for image in across]
    padded = [cv2.copyMakeBorder(image, 0, 0, max(margin, 0), max(-first, 0), cv2.BORDER_REPLICATE) for image in padded]
    length, last = -(-across[0].shape[0] // number), across[0].shape[0]
    strips = [slice(k * length, min((k + 1) * length, last) + 2 * around) for k in range(number)]
    with ThreadPoolExecutor(jobs) as pool:
        found = list(
            pool.map(lambda strip: _matcher(params, first, count).compute(padded[0][strip], padded[1][strip]), strips)
        )
    raw = np.concatenate([part[around : len(part) - around] for part in found])[:, max(margin, 0) :][
        :, : across[0].shape[1]
    ]
    disparity = raw.astype(np.float32) / np.float32(SGBM_SCALE)
    rows = np.arange(raw.shape[1], dtype=np.float32)
    disparity[(raw < SGBM_SCALE * first) | (rows - disparity < 0)] = np.nan  # no match, or beyond the pole
    return np.ascontiguousarray(disparity.T)


def refine(
    top: Image, bottom: Image, coarse: Plane, params: MatchParams, *, is_whole: bool, jobs: int = 1
) -> Disparity:
    """Align blocks of the upper image with the lower one along the column, starting from the matched disparity.

    The shift of a block minimises the squared grey-level difference beside a constant (cameras expose differently);
    with noise of variance s^2 in both images its variance is 2 s^2 / sum of squared slopes. What the calibration leaves
    comes on top.
    """
    margin = params.refine_radius * (2 * params.refine_steps + 1)  # columns whose disparity a strip's own ones see
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    planes = [cv2.copyMakeBorder(plane, 0, 0, margin, margin, border) for plane in (top, bottom, coarse)]
    length = -(-coarse.shape[1] // NUM_STRIPS)
    strips = [slice(k * length, min((k + 1) * length, coarse.shape[1]) + 2 * margin) for k in range(NUM_STRIPS)]

    def work(strip: slice) -> tuple[Plane, Plane]:
        above, below, start = (np.ascontiguousarray(plane[:, strip]) for plane in planes)
        return _refine_strip(above, below, start, margin, params)

    with ThreadPoolExecutor(jobs) as pool:
        parts = list(pool.map(work, strips))
    return Disparity(*(np.concatenate([part[k] for part in parts], axis=1) for k in range(2)))


def _refine_strip(top: Image, bottom: Image, start: Plane, margin: int, params: MatchParams) -> tuple[Plane, Plane]:
    area = (2 * params.refine_radius + 1) ** 2
    start, spare = _smoothed(start, np.empty_like(start), params), np.empty_like(start)
    refined, information, left = start.copy(), np.empty_like(start), np.empty_like(start)
    limits = np.array([STEP_LIMIT, MIN_BLOCK_SHARE * area, params.noise**2, params.match_px**2], np.float32)
    for _ in range(params.refine_steps):
        align_along_columns(top, bottom, start, limits, params.refine_radius, refined, information, left)
        refined = _smoothed(refined, spare, params)
    inner = slice(margin, -margin)
    refined, start, information, left = (plane[:, inner] for plane in (refined, start, information, left))
    with np.errstate(invalid="ignore", divide="ignore"):
        bad = ~(np.abs(refined - start) <= MAX_REFINEMENT) | ~(left <= params.max_residual)
        variance = np.maximum(left, 1.0) / information + params.calibration_px**2
    std = np.sqrt(variance).astype(np.float32)
    return np.where(bad, np.float32(np.nan), refined), np.where(bad, np.float32(np.nan), std)


def _smoothed(disparity: Plane, spare: Plane, params: MatchParams) -> Plane:
    out = np.empty_like(disparity)
    smooth(disparity, params.refine_radius, np.float32(SMOOTH_LIMIT), np.float32(SMOOTH_SHARE), spare, out)
    return out


def _smoothed_around(disparity: Plane, params: MatchParams, is_whole: bool) -> Plane:
    """Return the disparity without the stairs that whole pixels make of slanted surfaces."""
    margin = 2 * params.refine_radius
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    padded = cv2.copyMakeBorder(disparity, 0, 0, margin, margin, border)
    return np.ascontiguousarray(_smoothed(padded, np.empty_like(padded), params)[:, margin:-margin])


def _at_jumps(disparity: Plane, params: MatchParams, *, is_whole: bool) -> NDArray[np.bool_]:
    """Return the pixels next to a jump of disparity: blocks there see two surfaces, the nearer one looks too large.

    What a slanted surface changes by over the neighbourhood, at the least step from pixel to pixel in it, is no jump.
    """
    radius = params.edge_px
    if radius == 0:
        return np.zeros(disparity.shape, np.bool_)
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    padded = cv2.copyMakeBorder(disparity, 0, 0, radius + 1, radius + 1, border)
    known, kernel = ~np.isnan(padded), np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    high = cv2.dilate(np.where(known, padded, np.float32(-UNKNOWN_PX)), kernel)
    low = cv2.erode(np.where(known, padded, np.float32(UNKNOWN_PX)), kernel)
    slant = np.zeros_like(padded)
    for axis in range(2):
        step = np.abs(np.diff(padded, axis=axis, append=np.nan))
        least = cv2.erode(np.where(np.isnan(step), np.float32(UNKNOWN_PX), step), kernel)
        slant += np.where(least < UNKNOWN_PX, 2 * radius * least, np.float32(0.0))
    limit = np.maximum(np.float32(params.jump_px), np.float32(params.jump_share) * high) + slant
    return (high - low > limit)[:, radius + 1 : -radius - 1]


def _matcher(params: MatchParams, first: int, count: int) -> cv2.StereoSGBM:
    area = params.block_size**2
    return cv2.StereoSGBM_create(
        minDisparity=first,
        numDisparities=count,
        blockSize=params.block_size,
        P1=int(params.smoothness * area),
        P2=int(params.jump_penalty * area),
        disp12MaxDiff=params.max_left_right_px,
        preFilterCap=SATURATION,
        uniquenessRatio=params.uniqueness,
        speckleWindowSize=params.speckle_size,
        speckleRange=params.speckle_range,
        mode=cv2.STEREO_SGBM_MODE_SGBM,  # one thread, so the same bits every time
    )


def _shrunk(image: Image, halvings: int, is_whole: bool) -> Image:
    for _ in range(halvings):
        border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
        height, width = image.shape
        image = cv2.pyrDown(cv2.copyMakeBorder(image, 0, 0, 4, 4, border))[: height // 2, 2 : 2 + width // 2]
        # pixel k of the half is centred on pixel 2 k, not between 2 k and 2 k + 1: the refinement takes that up
    return np.ascontiguousarray(image)
