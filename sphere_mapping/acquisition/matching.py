"""Two images whose epipolar lines are columns -> disparity: whole spheres, which wrap around, windows, turned pairs.

Semi-global matching (Hirschmueller 2008) with left-right check gives disparity to about a quarter pixel, biased to
whole pixels; steps of one-dimensional alignment of small blocks at full resolution (the disparity of every pixel kept,
so that slanted ground is no problem) remove the bias and say how certain each pixel is. The same number of disparities
is searched at ever coarser levels until the nearest surface wanted is covered. A match stands only if the cost of its
block is clearly the least of all disparities searched: otherwise there is no texture, or it is repeated, or the
surface is out of reach, and nothing is known. A point is higher in the lower image: its row there is v - disparity.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.kernels import NUM_DISPARITIES, align_along_columns, cost_ratio, smooth
from sphere_mapping.acquisition.params import MatchParams

Plane = NDArray[np.float32]
Image = NDArray[np.uint8]

MAX_WIDTH = 1280  # columns up to which images are matched as they are; wider ones are halved
BLOCK_SIZE = 5  # px, side of the matched block
SMOOTHNESS, JUMP_PENALTY = 8 * BLOCK_SIZE**2, 32 * BLOCK_SIZE**2  # of a step of disparity by 1, of a larger one
UNIQUENESS = 5  # %, margin of the best smoothed cost over the second
MAX_LEFT_RIGHT_PX = 1  # disagreement allowed between both directions
SPECKLE_SIZE, SPECKLE_RANGE = 60, 2  # px: smaller islands of disparity, separated by larger steps, are removed
SATURATION = 31  # preFilterCap of the matcher
SGBM_SCALE = 16.0  # the matcher's disparities are sixteenths of a pixel
AROUND = 32  # columns beyond the seam that the matcher sees, so that it knows no seam
NUM_STRIPS = 2  # of a whole sphere, whatever the number of threads, so that the result does not depend on it

MIN_SIDE = 64  # px, of the coarsest level
BEYOND_PX = 3  # disparities this near to the largest of a level are left to the next coarser one

COST_RADIUS = 4  # px, half side of the block whose cost is compared over all disparities
COST_MEAN = 9  # px, side of the square whose mean grey level is taken away before
MIN_COST_RATIO = 1.35  # of the least cost elsewhere to that of the match

EDGE_PX = 3  # matches this near to a jump are not trusted
JUMP_PX, JUMP_SHARE = 0.6, 0.1  # least step of disparity over that neighbourhood that is a jump: px, by the disparity
REFINE_RADIUS, REFINE_STEPS = 3, 2  # half side in px of the blocks that are aligned, and how often
STEP_LIMIT = 0.5  # px, largest step of the refinement
MATCH_PX = 0.3  # standard deviation of a match: holds the refinement where there is little texture
MIN_BLOCK_SHARE = 0.2  # of a block's pixels must have a match
MAX_REFINEMENT = 1.6  # px; a block that wants to go farther from its match is not trusted
MAX_RESIDUAL = 1.0  # grey-level variance left in a block, by that of noise and contrast
SMOOTH_LIMIT, SMOOTH_SHARE = 1.0, 0.03  # px, and by the disparity: neighbours that differ more are not averaged
UNKNOWN_PX = 1e4  # stands for unknown where the largest or least is looked for


@dataclass(frozen=True)
class Search:
    """The least and the largest disparity looked for, px at full size; is_whole: the columns wrap around."""

    first_px: float
    last_px: float
    is_whole: bool = False


@dataclass(frozen=True, eq=False)
class Disparity:
    """Rows by which a pixel of the upper image moves up in the lower one, and its deviation, px; NaN unknown."""

    value: Plane
    std: Plane


def match_columns(
    top: Image,
    bottom: Image,
    search: Search,
    params: MatchParams,
    is_usable: NDArray[np.bool_],
    jobs: int = 1,
    edge_px: int = EDGE_PX,
) -> Disparity:
    """Return the disparity (H, W) of the upper image; both are (H, W) grey, `is_usable` where both show something."""
    halvings = max(int(np.ceil(np.log2(top.shape[1] / MAX_WIDTH))), 0)
    coarse = _match_levels(top, bottom, search, halvings, jobs)
    coarse = _smoothed_around(coarse, search.is_whole)
    coarse[_at_jumps(coarse, edge_px, is_whole=search.is_whole)] = np.nan
    for _ in range(halvings):
        coarse = _double(coarse)
    coarse = _fit(coarse, top.shape)
    coarse[~is_usable] = np.nan
    return refine(top, bottom, coarse, params, is_whole=search.is_whole, jobs=jobs)


def _match_levels(top: Image, bottom: Image, search: Search, halvings: int, jobs: int) -> Plane:
    """Return the disparity at a level: what it can reach itself, and what is nearer from coarser levels."""
    images = [top, bottom]
    for _ in range(halvings):
        images = [_halve(image, search.is_whole) for image in images]
    scale = 2.0**-halvings
    first = int(np.floor(search.first_px * scale))
    last = first + NUM_DISPARITIES - 1
    found = match_semi_globally(images[0], images[1], first, is_whole=search.is_whole, jobs=jobs)
    is_reached = search.last_px * scale <= last or min(images[0].shape) < 2 * MIN_SIDE
    found = _with_clear_cost(images[0], images[1], found, first, is_whole=search.is_whole, jobs=jobs)
    if is_reached:
        return found
    nearer = _fit(_double(_match_levels(top, bottom, search, halvings + 1, jobs)), found.shape)
    is_beyond = nearer > last - BEYOND_PX
    return np.where(is_beyond, nearer, found)


def _with_clear_cost(top: Image, bottom: Image, disparity: Plane, first: int, *, is_whole: bool, jobs: int) -> Plane:
    """Return the disparity (H, W) without what is not clearly the best of all disparities searched."""
    margin, height = COST_RADIUS, disparity.shape[0]
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    above, below = (
        cv2.copyMakeBorder(_without_mean(image, is_whole), 0, 0, margin, margin, border) for image in (top, bottom)
    )
    rows = np.clip(np.arange(height - 1 - first, -first - NUM_DISPARITIES, -1), 0, height - 1)
    above, below, start = (np.ascontiguousarray(plane.T) for plane in (above, below[rows], disparity))
    ratio = np.empty_like(start)
    length = -(-len(start) // NUM_STRIPS)

    def work(begin: int) -> None:
        end = min(begin + length, len(start))
        wide = slice(begin, end + 2 * margin)
        cost_ratio(above[wide], below[wide], start[begin:end], first, margin, ratio[begin:end])

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(work, range(0, len(start), length)))
    ratio = ratio.T
    return np.where(ratio >= MIN_COST_RATIO, disparity, np.float32(np.nan))


def _without_mean(image: Image, is_whole: bool) -> NDArray[np.int16]:
    """Return four times the grey levels (H, W) less the mean around them: exposure differs from camera to camera."""
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    padded = cv2.copyMakeBorder(image, 0, 0, COST_MEAN, COST_MEAN, border).astype(np.int16) * 4
    less = padded - cv2.blur(padded, (COST_MEAN, COST_MEAN))
    return less[:, COST_MEAN:-COST_MEAN]


def match_semi_globally(top: Image, bottom: Image, first: int, *, is_whole: bool, jobs: int = 1) -> Plane:
    """Return the checked disparity (H, W), NaN where both directions disagree, on islands and without a clear best."""
    across = [np.ascontiguousarray(image.T) for image in (top, bottom)]  # columns become the matcher's rows
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    margin = NUM_DISPARITIES + first
    around, number = (AROUND, NUM_STRIPS) if is_whole else (0, 1)
    padded = [cv2.copyMakeBorder(image, around, around, 0, 0, border) for image in across]
    padded = [cv2.copyMakeBorder(image, 0, 0, max(margin, 0), max(-first, 0), cv2.BORDER_REPLICATE) for image in padded]
    length, last = -(-across[0].shape[0] // number), across[0].shape[0]
    strips = [slice(k * length, min((k + 1) * length, last) + 2 * around) for k in range(number)]
    with ThreadPoolExecutor(jobs) as pool:
        found = list(pool.map(lambda strip: _matcher(first).compute(padded[0][strip], padded[1][strip]), strips))
    raw = np.concatenate([part[around : len(part) - around] for part in found])
    raw = raw[:, max(margin, 0) :][:, : across[0].shape[1]]
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
    margin = REFINE_RADIUS * (2 * REFINE_STEPS + 1)  # columns whose disparity a strip's own ones see
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
    area = (2 * REFINE_RADIUS + 1) ** 2
    start, spare = _smoothed(start, np.empty_like(start)), np.empty_like(start)
    refined, information, left = start.copy(), np.empty_like(start), np.empty_like(start)
    limits = np.array([STEP_LIMIT, MIN_BLOCK_SHARE * area, params.noise**2, MATCH_PX**2], np.float32)
    for _ in range(REFINE_STEPS):
        align_along_columns(top, bottom, start, limits, REFINE_RADIUS, refined, information, left)
        refined = _smoothed(refined, spare)
    inner = slice(margin, -margin)
    refined, start, information, left = (plane[:, inner] for plane in (refined, start, information, left))
    with np.errstate(invalid="ignore", divide="ignore"):
        bad = ~(np.abs(refined - start) <= MAX_REFINEMENT) | ~(left <= MAX_RESIDUAL)
        variance = np.maximum(left, 1.0) / information + params.calibration_px**2
    std = np.sqrt(variance).astype(np.float32)
    return np.where(bad, np.float32(np.nan), refined), np.where(bad, np.float32(np.nan), std)


def _smoothed(disparity: Plane, spare: Plane) -> Plane:
    out = np.empty_like(disparity)
    smooth(disparity, REFINE_RADIUS, np.float32(SMOOTH_LIMIT), np.float32(SMOOTH_SHARE), spare, out)
    return out


def _smoothed_around(disparity: Plane, is_whole: bool) -> Plane:
    """Return the disparity without the stairs that whole pixels make of slanted surfaces."""
    margin = 2 * REFINE_RADIUS
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    padded = cv2.copyMakeBorder(disparity, 0, 0, margin, margin, border)
    return np.ascontiguousarray(_smoothed(padded, np.empty_like(padded))[:, margin:-margin])


def _at_jumps(disparity: Plane, radius: int, *, is_whole: bool) -> NDArray[np.bool_]:
    """Return the pixels next to a jump of disparity: blocks there see two surfaces, the nearer one looks too large.

    What a slanted surface changes by over the neighbourhood, at the least step from pixel to pixel in it, is no jump.
    """
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
    limit = np.maximum(np.float32(JUMP_PX), np.float32(JUMP_SHARE) * high) + slant
    return (high - low > limit)[:, radius + 1 : -radius - 1]


def _matcher(first: int) -> cv2.StereoSGBM:
    return cv2.StereoSGBM_create(
        minDisparity=first,
        numDisparities=NUM_DISPARITIES,
        blockSize=BLOCK_SIZE,
        P1=SMOOTHNESS,
        P2=JUMP_PENALTY,
        disp12MaxDiff=MAX_LEFT_RIGHT_PX,
        preFilterCap=SATURATION,
        uniquenessRatio=UNIQUENESS,
        speckleWindowSize=SPECKLE_SIZE,
        speckleRange=SPECKLE_RANGE,
        mode=cv2.STEREO_SGBM_MODE_SGBM,  # one thread, so the same bits every time
    )


def _halve(image: Image, is_whole: bool) -> Image:
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    height, width = image.shape
    half = cv2.pyrDown(cv2.copyMakeBorder(image, 0, 0, 4, 4, border))[: height // 2, 2 : 2 + width // 2]
    # pixel k of the half is centred on pixel 2 k, not between 2 k and 2 k + 1: the refinement takes that up
    return np.ascontiguousarray(half)


def _double(disparity: Plane) -> Plane:
    return 2 * np.repeat(np.repeat(disparity, 2, axis=0), 2, axis=1)


def _fit(plane: Plane, shape: tuple[int, ...]) -> Plane:
    """Return the plane cut, or continued by NaN, to a shape."""
    plane = plane[: shape[0], : shape[1]]
    missing = [(0, side - found) for side, found in zip(shape, plane.shape, strict=True)]
    return np.pad(plane, missing, constant_values=np.nan) if plane.shape != shape else plane
