"""Range of a rig of two levels: a top and a bottom sphere, matched along their columns (M15 section 4.3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.epipolar import (
    baseline_error,
    correct_baseline,
    disparities_of_ranges,
    joined_share,
    range_from_disparity,
    to_common_center,
)
from sphere_mapping.acquisition.range.fusion import Ranged, StereoRange
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.semi_global import check_order, in_threads
from sphere_mapping.acquisition.stitching.blending import blend
from sphere_mapping.acquisition.stitching.layouts import MAX_LAYOUTS, Layouts
from sphere_mapping.acquisition.stitching.views import Layout
from sphere_nav.geometry.arrays import Bytes, Floats

LEVELS = ("top", "bottom")


class Baseline(NamedTuple):
    """What `epipolar.correct_baseline` takes: error (H, W) and shrink (H, W) of the baseline, 1/m of the joining."""

    error: Floats
    shrink: Floats
    per_m: float


class VerticalStereo:
    """Holds what is known of the levels. `is_checked`: that they are not exchanged; once is enough."""

    warning = ""

    def __init__(self, layouts: Layouts, params: StitchParams, jobs: int) -> None:
        self._layouts, self._params, self._jobs = layouts, params, jobs
        self._search = disparities_of_ranges(layouts.whole, layouts.baseline_m, params.match)
        self._kept: Callable[[tuple[str, ...]], Baseline] = lru_cache(MAX_LAYOUTS)(self._find_baseline)
        self.is_checked = False

    def find(self, grays: Mapping[str, Bytes]) -> StereoRange:
        """Return the range from the grey images of one instant, by camera: from the centre of the top sphere."""
        if not any(part.name in grays for part in self._layouts.rig.at_level("bottom")):
            return StereoRange()
        layouts = [self._layouts.of(level, tuple(grays)) for level in LEVELS]
        top, bottom = self.draw(layouts, grays)
        ranged, baseline = self._measure(layouts, top, bottom), self._kept(tuple(grays))
        correct_baseline(*ranged, baseline.error, baseline.shrink, baseline.per_m)
        ranged = to_common_center(*ranged, layouts[0], baseline.per_m)
        return StereoRange([ranged], bottom)

    def draw(self, layouts: Sequence[Layout], grays: Mapping[str, Bytes]) -> tuple[Bytes, Bytes]:
        """Return the grey spheres (H, W) of both levels, of a common distance."""
        top, bottom = in_threads(lambda layout: blend(layout, grays), layouts, self._jobs)
        return top, bottom

    def _measure(self, layouts: Sequence[Layout], top: Bytes, bottom: Bytes) -> Ranged:
        """Match both spheres, triangulate."""
        if not self.is_checked:
            check_order(top, bottom, LEVELS, is_whole=True)
            self.is_checked = True
        is_usable, match = layouts[0].is_covered & layouts[1].is_covered, self._params.match
        disparity = match_columns(top, bottom, self._search, match, is_usable, self._jobs)
        return range_from_disparity(disparity, self._layouts.whole, self._layouts.baseline_m, match)

    def _find_baseline(self, present: tuple[str, ...]) -> Baseline:
        """Return what the cameras present change in the baseline of each pixel."""
        layouts = [self._layouts.of(level, present) for level in LEVELS]
        baseline_m, distance_m = self._layouts.baseline_m, self._params.blend.distance_m
        error, per_m = baseline_error(layouts, baseline_m), 1.0 / distance_m if distance_m else 0.0
        return Baseline(error, 1.0 / (1.0 + joined_share(layouts[0], per_m)), per_m)
