"""Two images whose epipolar lines are columns -> disparity: whole spheres, which wrap around, windows, turned pairs.

Semi-global matching (Hirschmueller 2008) with left-right check gives disparity to about a quarter pixel, biased to
whole pixels; steps of one-dimensional alignment of small blocks (the disparity of every pixel kept, so that slanted
ground is no problem) remove the bias and say how certain each pixel is. Images are halved until the nearest surface
wanted is covered by as many disparities, and every level is matched and aligned by itself: where texture is too faint
for a fine level, a block of a coarser one sees more of the surface and less of the noise. A match stands only if the
cost of its block is clearly the least of all disparities searched: otherwise there is no texture, or it is repeated, or
the surface is out of reach, and nothing is known. A point is higher in the lower image: its row there is v - disparity.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.kernels import NUM_DISPARITIES, align_along_columns, smooth
from sphere_mapping.acquisition.levels import double, fit, halve, has_texture_around, interpolate, usable_at
from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.semi_global import NUM_STRIPS, Image, Plane, find_clear_matches, is_clear

Pair = tuple[Image, Image]  # of a level: upper, lower

MAX_WIDTH = 1280  # columns, of the whole sphere, up to which images are matched as they are; wider ones are halved

MIN_SIDE = 64  # px, of the coarsest level
BEYOND_PX = 3  # disparities this near to the largest of a level are left to the next coarser one

NUM_SCALES = 3  # levels that are matched at least
NUM_CHECKS = 2  # coarser levels that must find a match clear, too
MIN_COARSE_RATIO = 1.2  # of the least cost elsewhere to that of a match, seen at coarser levels
MIN_AGREEMENT = 0.95  # of the least cost elsewhere to that of a coarser level's disparity, seen at a finer level
SURER = 0.5  # of a finer level's deviation, below which a coarser level's disparity is preferred
LEAST_NOISE = 0.7  # grey levels, of a halved image: rounding and interpolation

EDGE_PX = 3  # matches this near to a jump are not trusted
JUMP_PX, JUMP_SHARE = 0.6, 0.1  # least step of disparity over that neighbourhood that is a jump: px, by the disparity
UNKNOWN_SIDE, FROM_UNKNOWN = 7, 2  # px: side of an unknown region that counts, and how far one keeps off it
REFINE_RADIUS, REFINE_STEPS = 3, 2  # half side in px of the blocks that are aligned, and how often
STEP_LIMIT = 0.5  # px, largest step of the refinement
MATCH_PX = 0.3  # standard deviation of a match: holds the refinement where there is little texture
MIN_BLOCK_SHARE = 0.2  # of a block's pixels must have a match
MAX_REFINEMENT = 1.6  # px; a block that wants to go farther from its match is not trusted
MAX_RESIDUAL = 1.0  # grey-level variance left in a block, by that of noise and contrast
STD_FACTOR = 1.3  # errors of neighbours are not independent: of the deviation that the residual alone gives
SMOOTH_LIMIT, SMOOTH_SHARE = 1.0, 0.03  # px, and by the disparity: neighbours that differ more are not averaged
UNKNOWN_PX = 1e4  # stands for unknown where the largest or least is looked for


@dataclass(frozen=True)
class Search:
    """The least and the largest disparity looked for, px at full size; is_whole: the columns wrap around.

    full_width: columns of the whole sphere that the images are windows of; 0: they are no part of one.
    """

    first_px: float
    last_px: float
    is_whole: bool = False
    full_width: float = 0.0


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
    halvings = max(int(np.ceil(np.log2((search.full_width or top.shape[1]) / MAX_WIDTH))), 0)
    levels = _levels_of(top, bottom, search, halvings)
    matched = _match_levels(levels[halvings:], search, halvings, jobs)
    start, found = matched[-1], None
    for k in reversed(range(len(levels))):
        start = _keep_sure(matched[k - halvings], search, edge_px) if k >= halvings else double(start)
        start = fit(start, levels[k][0].shape)
        start[~usable_at(is_usable, k, start.shape) | (start > search.last_px / 2**k + BEYOND_PX)] = np.nan
        if k > halvings:
            start[~has_texture_around(levels[k][0], search.is_whole)] = np.nan
        own = refine(*levels[k], start, _params_at(params, k), is_whole=search.is_whole, jobs=jobs)
        if found is not None:
            coarser = Disparity(
                *(fit(interpolate(2 * p, search.is_whole), start.shape) for p in (found.value, found.std))
            )
            if k >= halvings:
                coarser = _keep_undenied(levels[k], coarser, _first_at(search, k), search, jobs)
            own = _prefer(own, coarser)
        found = own
    assert found is not None
    return found


def _levels_of(top: Image, bottom: Image, search: Search, halvings: int) -> list[Pair]:
    """Return both images at full size, and halved until all disparities are reached and NUM_SCALES levels match."""
    levels = [(top, bottom)]
    while len(levels) <= halvings or not _is_reached(search, len(levels) - 1, levels[-1][0]):
        levels.append((halve(levels[-1][0], search.is_whole), halve(levels[-1][1], search.is_whole)))
    while len(levels) < halvings + NUM_SCALES and min(levels[-1][0].shape) >= 2 * MIN_SIDE:
        levels.append((halve(levels[-1][0], search.is_whole), halve(levels[-1][1], search.is_whole)))
    return levels


def _match_levels(levels: list[Pair], search: Search, halvings: int, jobs: int) -> list[Plane]:
    """Return the disparity of each level: what it can reach itself, and what is nearer from coarser levels.

    A level sees a part of all disparities, in which what is repeated may seem clear: the coarser ones, which see more,
    must find it clear, too.
    """
    found: list[Plane] = []
    for k in reversed(range(len(levels))):
        first = _first_at(search, halvings + k)
        own = find_clear_matches(levels[k][0], levels[k][1], first, is_whole=search.is_whole, jobs=jobs)
        coarser = own
        for n in range(k + 1, min(k + 1 + NUM_CHECKS, len(levels))):
            coarser = fit(coarser[::2, ::2] / np.float32(2), levels[n][0].shape)
            begin = _first_at(search, halvings + n)
            is_sure = is_clear(*levels[n], coarser, begin, MIN_COARSE_RATIO, is_whole=search.is_whole, jobs=jobs)
            coarser = np.where(is_sure, coarser, np.float32(np.nan))
            unsure = np.repeat(np.repeat(~is_sure, 2 ** (n - k), axis=0), 2 ** (n - k), axis=1)
            own[fit(unsure.astype(np.float32), own.shape) > 0] = np.nan
        if found:
            nearer = fit(double(found[0]), own.shape)
            own = np.where(nearer > first + NUM_DISPARITIES - 1 - BEYOND_PX, nearer, own)
        found.insert(0, own)
    return found


def _first_at(search: Search, level: int) -> int:
    return int(np.floor(search.first_px / 2**level))


def _keep_sure(matched: Plane, search: Search, edge_px: int) -> Plane:
    """Return matches without stairs, and none near jumps and unknown regions."""
    found = _smooth_around(matched, search.is_whole)
    near_jump = _at_jumps(found, edge_px, is_whole=search.is_whole)
    found[near_jump | _at_unknown(found, is_whole=search.is_whole)] = np.nan
    return found


def _keep_undenied(images: Pair, coarser: Disparity, first: int, search: Search, jobs: int) -> Disparity:
    """Return what a coarser level knows where the finer images, undecided, do not find another disparity better.

    So it is with patterns: blurred they may match in one place only, and wrongly.
    """
    is_least = is_clear(*images, coarser.value, first, MIN_AGREEMENT, is_whole=search.is_whole, jobs=jobs)
    keep = is_least | (coarser.value > first + NUM_DISPARITIES - 1)
    return Disparity(*(np.where(keep, plane, np.float32(np.nan)) for plane in (coarser.value, coarser.std)))


def _prefer(finer: Disparity, coarser: Disparity) -> Disparity:
    """Return the finer level's disparity, and the coarser one's where only that is known, or is much surer."""
    with np.errstate(invalid="ignore"):
        is_coarser = np.isnan(finer.value) | (coarser.std < SURER * finer.std)
    pairs = ((finer.value, coarser.value), (finer.std, coarser.std))
    return Disparity(*(np.where(is_coarser, theirs, own) for own, theirs in pairs))


def _params_at(params: MatchParams, level: int) -> MatchParams:
    """Return the noise that a level has: halving an image averages four pixels."""
    return replace(params, noise=max(params.noise / 2**level, min(params.noise, LEAST_NOISE)))


def _is_reached(search: Search, halvings: int, image: Image) -> bool:
    """Return whether a level sees all disparities, or is too small for another one below it."""
    last = int(np.floor(search.first_px / 2**halvings)) + NUM_DISPARITIES - 1
    return search.last_px / 2**halvings <= last or min(image.shape) < 2 * MIN_SIDE


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
    start, spare = _smooth(start, np.empty_like(start)), np.empty_like(start)
    refined, information, left = start.copy(), np.empty_like(start), np.empty_like(start)
    limits = np.array([STEP_LIMIT, MIN_BLOCK_SHARE * area, params.noise**2, MATCH_PX**2], np.float32)
    for _ in range(REFINE_STEPS):
        align_along_columns(top, bottom, start, limits, REFINE_RADIUS, refined, information, left)
        refined = _smooth(refined, spare)
    inner = slice(margin, -margin)
    per_slope = _slope_across(top)[:, inner]
    refined, start, information, left = (plane[:, inner] for plane in (refined, start, information, left))
    with np.errstate(invalid="ignore", divide="ignore"):
        bad = ~(np.abs(refined - start) <= MAX_REFINEMENT) | ~(left <= MAX_RESIDUAL)
        variance = STD_FACTOR**2 / information + params.calibration_px**2 * (1 + per_slope)
    std = np.sqrt(variance).astype(np.float32)
    return np.where(bad, np.float32(np.nan), refined), np.where(bad, np.float32(np.nan), std)


def _slope_across(image: Image) -> Plane:
    """Return the mean squared slope across the columns of each block, by that along them.

    Calibration leaves as much across as along: on a line that runs nearly along the column it becomes disparity.
    """
    side = (2 * REFINE_RADIUS + 1,) * 2
    across, along = (
        cv2.boxFilter(np.square(cv2.Sobel(image, cv2.CV_32F, *axis, ksize=3)), -1, side) for axis in ((1, 0), (0, 1))
    )
    return across / np.maximum(along, np.float32(1.0))


def _smooth(disparity: Plane, spare: Plane) -> Plane:
    out = np.empty_like(disparity)
    smooth(disparity, REFINE_RADIUS, np.float32(SMOOTH_LIMIT), np.float32(SMOOTH_SHARE), spare, out)
    return out


def _smooth_around(disparity: Plane, is_whole: bool) -> Plane:
    """Return the disparity without the stairs that whole pixels make of slanted surfaces."""
    margin = 2 * REFINE_RADIUS
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    padded = cv2.copyMakeBorder(disparity, 0, 0, margin, margin, border)
    return np.ascontiguousarray(_smooth(padded, np.empty_like(padded))[:, margin:-margin])


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


def _at_unknown(disparity: Plane, *, is_whole: bool) -> NDArray[np.bool_]:
    """Return the pixels next to a large unknown region: their blocks may see the border of what is before it."""
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    margin = UNKNOWN_SIDE
    unknown = cv2.copyMakeBorder(np.isnan(disparity).astype(np.uint8), 0, 0, margin, margin, border)
    square = np.ones((UNKNOWN_SIDE, UNKNOWN_SIDE), np.uint8)
    large = cv2.morphologyEx(unknown, cv2.MORPH_OPEN, square)
    near = cv2.dilate(large, np.ones((2 * FROM_UNKNOWN + 1, 2 * FROM_UNKNOWN + 1), np.uint8))
    return near[:, margin:-margin] > 0
