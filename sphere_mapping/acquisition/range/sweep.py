"""Range of cameras that look different ways: one sweep on the sphere over all that see a direction.

At the coarsest level every direction is tried at NUM_HYPOTHESES inverse ranges: each camera that sees it is sampled
there from its own image, and the levels of all pairs, less their mean around, are compared. These costs are smoothed
semi-globally (Hirschmueller 2008); one that is not clearly the least of its block is no match. From there on, level by
level, Gauss-Newton steps move the inverse range of every block until all its cameras show the same. Nothing is
rectified, no window is moved onto the sphere, nothing is to be joined. The deviation is by the slopes of the levels and
by what is left; edges, what does not fit and what is not clear are NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    COST_RADIUS,
    DEPENDENT_SHARE,
    FAR_M,
    GRID_STEP,
    LEVEL_BLUR_PX,
    MAX_REFINEMENT,
    MAX_RESIDUAL,
    MAX_ROW_STEP,
    MAX_SWEEP_WIDTH,
    MAX_UNLIKE,
    MIN_BLOCK_SHARE,
    MIN_COST_RATIO,
    MIN_RANGE_SHARE,
    MISALIGNED,
    REFINE_RADIUS,
    REFINE_STEPS,
    SMOOTH_RADIUS,
    STEP_LIMIT,
    SWEEP_FLOOR,
    SWEEP_PENALTIES,
    SWEEP_RADIUS,
)
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.fusion import Ranged
from sphere_mapping.acquisition.range.kernels import (
    NUM_HYPOTHESES,
    SCALE,
    UNSEEN,
    align,
    choose,
    sum_blocks,
    sum_paths,
    sweep,
)
from sphere_mapping.acquisition.range.levels import (
    around,
    at_unknown,
    is_unlike,
    noise_of,
    smooth_around,
    spread_around,
    twice,
)
from sphere_mapping.acquisition.range.semi_global import in_strips, in_threads
from sphere_mapping.acquisition.range.sweep_tables import (
    CameraSight,
    hypotheses_of,
    hypothesis_table,
    level_of,
    sharpness,
    sight_of,
    why_no_range,
)
from sphere_mapping.acquisition.stitching.layouts import MAX_LAYOUTS, Layouts
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes, Floats

Levels = NDArray[np.int16]


class SphereSweep:
    """Range of a rig of one level. `warning`: why there will be none, empty where there will be."""

    is_checked = True  # there is no order to check

    def __init__(self, layouts: Layouts, params: StitchParams, jobs: int) -> None:
        self._params, self._jobs = params, jobs
        self._views = list(layouts.views.values())
        self.warning = why_no_range(layouts.rig)
        if self.warning:
            return
        num_halvings = max(int(np.ceil(np.log2(layouts.whole.width / MAX_SWEEP_WIDTH))), 0)
        wholes = [Spherical(layouts.whole.width >> k, layouts.whole.height >> k) for k in range(num_halvings + 1)]
        self._levels = [level_of(whole, self._views) for whole in wholes]
        self._first, self._step = hypotheses_of(self._views, wholes[-1], params.match.nearest_m)
        self._table = hypothesis_table(self._views, self._levels[-1], self._first, self._step)
        *lenses, tables = map(np.stack, zip(*(view.lens for view in self._views), strict=True))
        self._lens = (*lenses, np.ascontiguousarray(tables[..., :2].reshape(len(tables), -1, 2)))
        self._stretch = sharpness(self._views, wholes[-1])
        names = [view.name for view in self._views]
        self._kept: Callable[[tuple[str, ...]], CameraSight] = lru_cache(MAX_LAYOUTS)(
            lambda present: sight_of(self._stretch, np.isin(names, present), self._levels)
        )

    def find(self, grays: Mapping[str, Bytes]) -> list[Ranged]:
        """Return the range from the grey images of one instant, by camera."""
        if self.warning or len(grays) < 2:
            return []
        sight = self._kept(tuple(view.name for view in self._views if view.name in grays))
        levels, matched = self._levels_of(grays)
        inverse = self._match(matched, sight)
        std = np.full_like(inverse, np.nan)
        for k in reversed(range(len(self._levels))):
            if k < len(self._levels) - 1:
                inverse = _double(inverse)
            inverse, std = self._refine(k, levels[k], inverse, sight)
        return [self._range_of(inverse, std)]

    def _levels_of(self, grays: Mapping[str, Bytes]) -> tuple[list[Levels], Levels]:
        """Return the levels of all cameras in one buffer for each level of the sphere; and those to be matched."""
        found = [np.full(level.starts[-1], UNSEEN, np.int16) for level in self._levels]
        matched = found[-1].copy()

        def work(c: int) -> None:
            image, halved = grays[self._views[c].name].astype(np.int16) * SCALE, 0
            for level, buffer in zip(self._levels, found, strict=True):
                for _ in range(level.halvings[c] - halved):
                    image = cv2.pyrDown(image)
                halved, own = level.halvings[c], slice(level.starts[c], level.starts[c + 1])
                blurred = image.copy() if halved else cv2.GaussianBlur(image, (0, 0), LEVEL_BLUR_PX)
                blurred[level.is_dead[c]] = UNSEEN
                buffer[own] = blurred.ravel()
            less = image - cv2.blur(image, (2 * COST_RADIUS + 1,) * 2)  # exposures are never quite equal
            less[self._levels[-1].is_dead[c]] = UNSEEN
            matched[own] = less.ravel()

        in_threads(work, [c for c, view in enumerate(self._views) if view.name in grays], self._jobs)
        return found, matched

    def _match(self, images: Levels, sight: CameraSight) -> Floats:
        """Return the inverse range (h, w) at the coarsest level, NaN where nothing is clearly the best."""
        level, shape = self._levels[-1], sight.numbers.shape
        cost = np.empty((*shape, NUM_HYPOTHESES), np.uint8)
        block, wide, total = (np.zeros(cost.shape, np.int16) for _ in range(3))
        tables = (self._table, GRID_STEP, images, level.starts, level.sizes, sight.cameras, sight.numbers)
        in_strips(lambda *rows: sweep(*tables, *rows, cost), shape[0], self._jobs)
        for radius, sums in ((SWEEP_RADIUS, block), (COST_RADIUS, wide)):
            padded = around(cost, radius, is_whole=True)
            sum_blocks(cv2.copyMakeBorder(padded, radius, radius, 0, 0, cv2.BORDER_REPLICATE), radius, sums)
        sum_paths(block, *np.array(SWEEP_PENALTIES, np.int16), total)
        found, floor = np.empty(shape, np.float32), SWEEP_FLOOR * (2 * COST_RADIUS + 1) ** 2
        choose(total, wide, *np.array([floor, MIN_COST_RATIO], np.float32), found)
        found = smooth_around(found, REFINE_RADIUS - 1, is_whole=True)
        found[at_unknown(found, is_whole=True)] = np.nan
        return (np.float32(self._first) + found * np.float32(self._step)).astype(np.float32)

    def _refine(self, k: int, images: Levels, start: Floats, sight: CameraSight) -> tuple[Floats, Floats]:
        """Return inverse range and deviation (H, W) of a level, from where the coarser one has ended."""
        from_coarsest, found = len(self._levels) - 1 - k, start
        std, left, unlike = (np.empty_like(start) for _ in range(3))
        for _ in range(REFINE_STEPS if from_coarsest == 0 else 1):
            found = self._align(k, images, (found, start), sight, (std, left, unlike))
        does_fit = left <= MAX_RESIDUAL
        px = np.float32(self._step / 2**from_coarsest)  # about a pixel of the coarsest level, at this one
        if k > 0:
            found = np.where(does_fit, found, start)  # a finer level, whose blocks are smaller, may tell
            return smooth_around(found / px, SMOOTH_RADIUS, is_whole=True) * px, std
        std[~does_fit] = np.nan
        found[np.isnan(std)] = np.nan
        found = smooth_around(found / px, SMOOTH_RADIUS, is_whole=True)
        half = np.ascontiguousarray(found[::2, ::2])
        spread = twice(spread_around(half, COST_RADIUS, is_whole=True))
        found[is_unlike(unlike, spread, found, MAX_UNLIKE)] = np.nan
        return found * px, std

    def _align(
        self, k: int, images: Levels, before: tuple[Floats, Floats], sight: CameraSight, rest: Sequence[Floats]
    ) -> Floats:
        """Return inverse range (H, W) moved by a step, from itself and its start; write what else `align` does."""
        level, match, out = self._levels[k], self._params.match, np.empty_like(before[0])
        every = min(len(self._levels) - k, MAX_ROW_STEP)  # rows next to each other tell nearly the same
        noise = SCALE * noise_of(match.noise, min(level.halvings))
        least = MIN_BLOCK_SHARE * (2 * REFINE_RADIUS + 1) ** 2 / every
        own = (STEP_LIMIT, least, noise**2, MAX_REFINEMENT, MAX_REFINEMENT, match.calibration_px, DEPENDENT_SHARE)
        limits, pictures = np.array([*own, MISALIGNED], np.float32), (images, level.starts, level.sizes, level.scales)
        given = (*before, level.directions, pictures, self._lens, sight.runs[k], sight.first_runs[k])
        numbers = (REFINE_RADIUS, every, limits)
        in_strips(lambda *rows: align(*given, *numbers, rows, out, *rest), len(out), self._jobs)
        return out

    def _range_of(self, inverse: Floats, std: Floats) -> Ranged:
        """Return range and deviation (H, W) of inverse ones; what is surely beyond FAR_M is far."""
        match, two = self._params.match, np.float32(2.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = np.float32(1.0) / inverse
            std_m = std * range_m * range_m
            is_far = inverse + two * std < np.float32(1.0 / FAR_M)
            is_good = (inverse > two * std) & (std_m <= np.float32(match.max_relative_std) * range_m)
            is_good &= range_m >= np.float32(MIN_RANGE_SHARE * match.nearest_m)
        range_m[~is_good], std_m[~is_good | is_far] = np.nan, np.nan
        range_m[is_far] = np.inf
        return range_m, std_m


def _double(inverse: Floats) -> Floats:
    """Return a plane (2 h, 2 w) whose pixels have twice the size: linear between, NaN beside NaN."""
    padded = around(inverse, 2, is_whole=True)
    return np.ascontiguousarray(cv2.resize(padded, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)[:, 4:-4])
