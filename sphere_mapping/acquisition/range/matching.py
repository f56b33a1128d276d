"""Two images whose epipolar lines are columns -> disparity: whole spheres, which wrap around, windows, turned pairs.

Semi-global matching (Hirschmueller 2008) with left-right check gives disparity to about a quarter pixel, biased to
whole pixels; steps of one-dimensional alignment of small blocks (the disparity of every pixel kept, so that slanted
ground is no problem) remove the bias and say how certain each pixel is. Images are halved until the nearest surface
wanted is covered by as many disparities, and every level is matched and aligned by itself: where texture is too faint
for a fine level, a block of a coarser one sees more of the surface and less of the noise. The levels finer than those
that are matched start where the coarser one has ended. A match stands only if the
cost of its block is clearly the least of all disparities searched: otherwise there is no texture, or it is repeated, or
the surface is out of reach, and nothing is known. At the end, what a pixel has from its block only, and does not show
itself, is unknown. A point is higher in the lower image: its row there is v - disparity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from sphere_mapping.acquisition.constants import (
    BEYOND_PX,
    MATCH_PX,
    MAX_REFINEMENT,
    MAX_RESIDUAL,
    MAX_WIDTH,
    MIN_BLOCK_SHARE,
    MIN_SIDE,
    NUM_SCALES,
    REFINE_RADIUS,
    REFINE_STEPS,
    SMOOTH,
    STEP_LIMIT,
    UNEVEN_SHARE,
)
from sphere_mapping.acquisition.kernels import compare_images, judge_blocks, smooth, step_blocks
from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.kernels import INDEPENDENT, NUM_DISPARITIES
from sphere_mapping.acquisition.range.levels import (
    around,
    at_jumps,
    at_unknown,
    fit,
    halve_image,
    interpolate,
    is_borrowed,
    noise_of,
    smooth_around,
    twice,
    uneven_around,
    usable_at,
)
from sphere_mapping.acquisition.range.semi_global import find_clear_matches, in_strips
from sphere_nav.geometry.arrays import Bytes, Flags, Floats

Pair = tuple[Bytes, Bytes]  # of a level: upper, lower


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

    value: Floats
    std: Floats


def match_columns(
    top: Bytes,
    bottom: Bytes,
    search: Search,
    params: MatchParams,
    is_usable: Flags,
    jobs: int = 1,
) -> Disparity:
    """Return the disparity (H, W) of the upper image; both are (H, W) grey, `is_usable` where both show something."""
    halvings = max(int(np.ceil(np.log2((search.full_width or top.shape[1]) / MAX_WIDTH))), 0)
    levels = _levels_of(top, bottom, search, halvings)
    start = np.empty((0, 0), np.float32)
    matched: Floats | None = None
    found: Disparity | None = None
    for k in reversed(range(len(levels))):
        shape = levels[k][0].shape
        coarser = None if found is None else _interpolate(found, shape, search.is_whole)
        if k >= halvings:
            matched = _match_level(levels[k], int(np.floor(search.first_px / 2**k)), matched, search, jobs)
            start = _keep_sure(matched, search)
        else:
            assert coarser is not None
            start = _start_again(start, coarser.value)
        start[~usable_at(is_usable, k, shape) | (start > search.last_px / 2**k + BEYOND_PX)] = np.nan
        num_steps = REFINE_STEPS if k >= halvings else 1
        own_params = replace(params, noise=noise_of(params.noise, k))
        own = refine(*levels[k], start, own_params, num_steps, is_whole=search.is_whole, jobs=jobs)
        if coarser is not None:
            is_unknown = np.isnan(own.value)
            own.value[is_unknown], own.std[is_unknown] = coarser.value[is_unknown], coarser.std[is_unknown]
        if k >= halvings:  # a block does not tell which of the surfaces in it the pixel shows
            _, uneven = uneven_around(own.value, REFINE_RADIUS, is_whole=search.is_whole)
            np.maximum(own.std, np.float32(UNEVEN_SHARE) * uneven, out=own.std)
        found = own
    assert found is not None
    return _without_borrowed(found, levels[1], search.is_whole) if halvings else found


def _without_borrowed(found: Disparity, half: Pair, is_whole: bool) -> Disparity:
    """Return what pixels show themselves, seen at half the size, where noise is less.

    Spheres that are matched at their full size have too few pixels for it.
    """
    height, width = half[0].shape
    disparity = np.ascontiguousarray(found.value[::2, ::2][:height, :width] * np.float32(0.5))
    borrowed = is_borrowed(*half, disparity, is_whole=is_whole)
    lost = twice(np.where(borrowed, np.float32(np.nan), np.float32(0)))
    for plane in (found.value, found.std):
        plane[: 2 * height, : 2 * width] += lost
    return found


def _levels_of(top: Bytes, bottom: Bytes, search: Search, halvings: int) -> list[Pair]:
    """Return both images at full size, and halved until all disparities are reached and NUM_SCALES levels match."""
    levels = [(top, bottom)]
    while (
        len(levels) <= halvings
        or not _is_reached(search, len(levels) - 1, levels[-1][0])
        or (len(levels) < halvings + NUM_SCALES and min(levels[-1][0].shape) >= 2 * MIN_SIDE)
    ):
        top, bottom = (halve_image(image, search.is_whole) for image in levels[-1])
        levels.append((top, bottom))
    return levels


def _match_level(pair: Pair, first: int, coarser: Floats | None, search: Search, jobs: int) -> Floats:
    """Return the disparity of a level where its match is clear; what is nearer than it sees is the coarser level's."""
    own = find_clear_matches(*pair, first, is_whole=search.is_whole, jobs=jobs)
    if coarser is None:
        return own
    nearer = fit(2 * twice(coarser), own.shape)
    return np.where(nearer > first + NUM_DISPARITIES - 1 - BEYOND_PX, nearer, own)


def _interpolate(found: Disparity, shape: tuple[int, ...], is_whole: bool) -> Disparity:
    return Disparity(*(fit(interpolate(plane, is_whole), shape) for plane in (found.value, found.std)))


def _start_again(matched: Floats, aligned: Floats) -> Floats:
    """Return where a level that is not matched itself starts: what the coarser one has aligned, else its match."""
    match = fit(2 * twice(matched), aligned.shape)
    return np.where(np.abs(aligned - match) <= np.float32(2 * MAX_REFINEMENT), aligned, match)


def _keep_sure(matched: Floats, search: Search) -> Floats:
    """Return matches without stairs, and none near jumps and unknown regions."""
    found = smooth_around(matched, REFINE_RADIUS, is_whole=search.is_whole)
    near_jump = at_jumps(found, REFINE_RADIUS, is_whole=search.is_whole)
    found[near_jump | at_unknown(found, is_whole=search.is_whole)] = np.nan
    return found


def _is_reached(search: Search, halvings: int, image: Bytes) -> bool:
    """Return whether a level sees all disparities, or is too small for another one below it."""
    last = int(np.floor(search.first_px / 2**halvings)) + NUM_DISPARITIES - 1
    return search.last_px / 2**halvings <= last or min(image.shape) < 2 * MIN_SIDE


def refine(
    top: Bytes, bottom: Bytes, coarse: Floats, params: MatchParams, num_steps: int, *, is_whole: bool, jobs: int = 1
) -> Disparity:
    """Align blocks of the upper image with the lower one along the column, starting from the matched disparity.

    The shift of a block minimizes the squared grey-level difference beside a constant (cameras expose differently);
    with noise of variance s^2 in both images its variance is 2 s^2 / sum of squared slopes. What the calibration leaves
    comes on top.
    """
    margin = REFINE_RADIUS * (2 * num_steps + 1)  # columns whose disparity a strip's own ones see
    planes = [around(plane, margin, is_whole=is_whole) for plane in (top, bottom, coarse)]
    value, std = np.empty_like(coarse), np.empty_like(coarse)

    def work(begin: int, end: int) -> None:
        above, below, start = (np.ascontiguousarray(plane[:, begin : end + 2 * margin]) for plane in planes)
        _refine_strip(above, below, start, (margin, num_steps), params, value[:, begin:end], std[:, begin:end])

    in_strips(work, coarse.shape[1], jobs)
    return Disparity(value, std)


def _refine_strip(
    top: Bytes, bottom: Bytes, start: Floats, sizes: tuple[int, int], params: MatchParams, value: Floats, std: Floats
) -> None:
    """Write a strip's disparity and deviation; sizes: columns of margin, number of steps."""
    (margin, num_steps), side = sizes, 2 * REFINE_RADIUS + 1
    start = smooth(start, REFINE_RADIUS, *SMOOTH)
    refined, information, left = start.copy(), np.empty_like(start), np.empty_like(start)
    limits = np.array([STEP_LIMIT, MIN_BLOCK_SHARE * side**2, params.noise**2, MATCH_PX**2], np.float32)
    sums = np.empty((6, *start.shape), np.int32)
    for _ in range(num_steps):
        compare_images(top, bottom, refined, sums)
        for plane in sums:
            cv2.boxFilter(plane, cv2.CV_32S, (side, side), plane, normalize=False, borderType=cv2.BORDER_CONSTANT)
        own = (plane.ravel() for plane in (start, refined, information, left))
        step_blocks(sums.reshape(6, -1), limits, *own)
        refined = smooth(refined, REFINE_RADIUS, *SMOOTH)
    inner = slice(margin, margin + value.shape[1])
    own = (plane[:, inner] for plane in (start, refined, information, left))
    trusted = tuple(map(np.float32, (MAX_REFINEMENT, MAX_RESIDUAL, INDEPENDENT, params.calibration_px**2)))
    judge_blocks(*own, _squared_slopes(top)[:, :, inner], trusted, value, std)


def _squared_slopes(image: Bytes) -> Floats:
    """Return the mean squared slopes (2, H, W) of each block across and along the columns."""
    side = (2 * REFINE_RADIUS + 1,) * 2
    slopes = np.empty((2, *image.shape), np.float32)
    for axis, plane in zip(((1, 0), (0, 1)), slopes, strict=True):
        cv2.sqrBoxFilter(cv2.Sobel(image, cv2.CV_32F, *axis, ksize=3), cv2.CV_32F, side, plane)
    return slopes
