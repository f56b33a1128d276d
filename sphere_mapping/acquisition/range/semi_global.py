"""Matches along columns at one level: semi-global (Hirschmueller 2008), and clearly the best of all that is searched.

Smoothness carries a match far into what has no texture or is repeated; so the cost of the match's own block, without
any smoothness, is compared with that of all other disparities.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    COST_RADIUS,
    EXCHANGED,
    MIN_COST_RATIO,
    NUM_STRIPS,
    ORDER_COLUMNS,
    SEAM_COLUMNS,
    SGBM,
    STRIP_COLUMNS,
)
from sphere_mapping.acquisition.range.kernels import (
    COST_NOISE,
    NUM_DISPARITIES,
    compare_levels,
    cost_ratios,
    sum_blocks,
)
from sphere_mapping.acquisition.range.levels import around
from sphere_nav.geometry.arrays import Bytes, Floats

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_pool = cache(ThreadPoolExecutor)
os.register_at_fork(after_in_child=_pool.cache_clear)  # threads stay with the parent


def in_threads(work: Callable[[Item], Answer], items: Iterable[Item], jobs: int) -> list[Answer]:
    """Return the answers for all items. The threads stay: OpenCV loses 0.6 kB with each thread that ends."""
    return list(map(work, items) if jobs == 1 else _pool(jobs).map(work, items))


def in_strips(work: Callable[[int, int], Answer], size: int, jobs: int, number: int = NUM_STRIPS) -> list[Answer]:
    """Return the answers for strips of so many rows or columns: the first, and that beyond the last."""
    edges = np.linspace(0, size, number + 1).astype(int).tolist()
    return in_threads(lambda ends: work(*ends), pairwise(edges), jobs)


def find_clear_matches(top: Bytes, bottom: Bytes, first: int, *, is_whole: bool, jobs: int = 1) -> Floats:
    """Return the disparity (H, W) from `first` on, NaN where no match is clearly the best of those searched."""
    found = match_semi_globally(top, bottom, first, is_whole=is_whole, jobs=jobs)
    found[~(compare_costs(top, bottom, found, first, is_whole=is_whole, jobs=jobs) >= MIN_COST_RATIO)] = np.nan
    return found


def compare_costs(top: Bytes, bottom: Bytes, disparity: Floats, first: int, *, is_whole: bool, jobs: int) -> Floats:
    """Return the least cost elsewhere, of all disparities that a level sees, over that of one (H, W); NaN for NaN."""
    margin, height = COST_RADIUS, top.shape[0]
    levels = [_without_mean(image, is_whole) for image in (top, bottom)]
    up, down = (cv2.addWeighted(levels[1], 0.5, np.roll(levels[1], step, axis=0), 0.5, 0) for step in (1, -1))
    low, high = np.minimum(np.minimum(up, down), levels[1]), np.maximum(np.maximum(up, down), levels[1])
    planes = [around(plane, margin, is_whole=is_whole) for plane in (levels[0], low, high)]
    rows = np.clip(np.arange(height - 1 - first, -first - NUM_DISPARITIES, -1), 0, height - 1)
    above, least, largest = (np.ascontiguousarray(plane.T) for plane in (planes[0], planes[1][rows], planes[2][rows]))
    start = np.ascontiguousarray(disparity.T)
    ratio, floor = np.empty_like(start), np.float32(COST_NOISE * (2 * margin + 1) ** 2)

    def work(begin: int, end: int) -> None:
        wide = slice(begin, end + 2 * margin)
        cost = np.empty((end - begin + 2 * margin, height, NUM_DISPARITIES), np.uint8)
        compare_levels(above[wide], least[wide], largest[wide], cost)
        cost = cv2.copyMakeBorder(cost, 0, 0, margin, margin, cv2.BORDER_REPLICATE)
        block = np.empty((end - begin, height, NUM_DISPARITIES), np.int16)
        sum_blocks(cost, margin, block)
        cost_ratios(block, start[begin:end], first, floor, ratio[begin:end])

    in_strips(work, len(start), jobs, -(-len(start) // STRIP_COLUMNS))
    return ratio.T


def match_semi_globally(top: Bytes, bottom: Bytes, first: int, *, is_whole: bool, jobs: int = 1) -> Floats:
    """Return the checked disparity (H, W), NaN where both directions disagree, on islands and without a clear best."""
    across = [np.ascontiguousarray(image.T) for image in (top, bottom)]  # columns become the matcher's rows
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    margin = NUM_DISPARITIES + first
    around, number = (SEAM_COLUMNS, NUM_STRIPS) if is_whole else (0, 1)
    padded = [cv2.copyMakeBorder(image, around, around, 0, 0, border) for image in across]
    padded = [cv2.copyMakeBorder(image, 0, 0, max(margin, 0), max(-first, 0), cv2.BORDER_REPLICATE) for image in padded]

    def work(begin: int, end: int) -> NDArray[np.int16]:
        strip = [image[begin : end + 2 * around] for image in padded]
        return np.asarray(_matcher(first, is_whole).compute(*strip)[around : around + end - begin], np.int16)

    raw = np.concatenate(in_strips(work, len(across[0]), jobs, number))
    raw = raw[:, max(margin, 0) :][:, : across[0].shape[1]]
    scale = cv2.StereoMatcher_DISP_SCALE
    disparity = raw.astype(np.float32) / np.float32(scale)
    rows = np.arange(raw.shape[1], dtype=np.float32)
    disparity[(raw < scale * first) | (rows - disparity < 0)] = np.nan  # no match, or beyond the pole
    return np.ascontiguousarray(disparity.T)


def _without_mean(image: Bytes, is_whole: bool) -> NDArray[np.int16]:
    """Return four times the grey levels (H, W) less the mean around them: exposure differs from camera to camera."""
    side = 2 * COST_RADIUS + 1
    padded = around(image, side, is_whole=is_whole).astype(np.int16) * 4
    less = padded - cv2.blur(padded, (side, side))
    return less[:, side:-side]


def _matcher(first: int, is_whole: bool) -> cv2.StereoSGBM:
    """Return the matcher; its modes are those of one thread, so the same bits every time.

    Its first mode smooths down the rows only, so that where disparity grows from row to row, as on the road before a
    pair, it lags by half a pixel; the other one smooths up the rows, too. Rows of a whole sphere are its columns, along
    which disparity grows here and falls there.
    """
    mode = cv2.STEREO_SGBM_MODE_SGBM if is_whole else cv2.STEREO_SGBM_MODE_HH
    return cv2.StereoSGBM_create(minDisparity=first, numDisparities=NUM_DISPARITIES, **SGBM, mode=mode)


def check_order(top: Bytes, bottom: Bytes, names: tuple[str, str], *, is_whole: bool) -> None:
    """Raise ValueError if grey images (H, W) match with positive disparity only when they are exchanged.

    Disparities below one pixel of the shrunk images count for neither order: far scenes are no evidence.
    """
    small = [shrink(image, ORDER_COLUMNS)[0] for image in (top, bottom)]
    found = [find_clear_matches(a, b, 0, is_whole=is_whole) for a, b in (small, small[::-1])]
    given, exchanged = (float(np.mean(np.nan_to_num(one, nan=0.0) > 1.0)) for one in found)
    least, factor = EXCHANGED
    if exchanged > least and exchanged > factor * given:
        first, second = names
        raise ValueError(
            f"{first} and {second} image: expected disparities above 0, found {given:.0%} of the pixels matched, and "
            f"{exchanged:.0%} with the images exchanged"
        )


def shrink(image: Bytes, longest: int) -> tuple[Bytes, float]:
    """Return a grey image whose longer side has so many pixels at most, and by what factor it was longer."""
    factor = max(max(image.shape) / longest, 1.0)
    size = (round(image.shape[1] / factor), round(image.shape[0] / factor))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8), factor
