"""Range of a rig of two levels: a top and a bottom sphere, matched along their columns (M15 section 4.3)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import FAR_M, MIN_RANGE_SHARE, RECTIFIED_PX
from sphere_mapping.acquisition.kernels import recenter, triangulate
from sphere_mapping.acquisition.params import MatchParams, StitchParams
from sphere_mapping.acquisition.range.fusion import Ranged
from sphere_mapping.acquisition.range.matching import Disparity, Search, match_columns
from sphere_mapping.acquisition.range.semi_global import check_order, in_threads
from sphere_mapping.acquisition.stitching.blending import blend
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_mapping.acquisition.stitching.views import axes_of
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes, Floats

LEVELS = ("top", "bottom")


class VerticalStereo:
    """Holds what is known of the levels. `is_checked`: that they are not exchanged; once is enough."""

    warning = ""

    def __init__(self, layouts: Layouts, params: StitchParams, jobs: int) -> None:
        self._layouts, self._params, self._jobs = layouts, params, jobs
        self._search = disparities_of_ranges(layouts.whole, layouts.baseline_m, params.match)
        self.is_checked = False

    def find(self, grays: Mapping[str, Bytes]) -> list[Ranged]:
        """Return the range from the grey images of one instant, by camera."""
        if not any(part.name in grays for part in self._layouts.rig.at_level("bottom")):
            return []
        layouts = [self._layouts.of(level, tuple(grays)) for level in LEVELS]
        top, bottom = in_threads(lambda layout: blend(layout, grays), layouts, self._jobs)  # of a common distance
        if not self.is_checked:
            check_order(top, bottom, LEVELS, is_whole=True)
            self.is_checked = True
        is_usable, match = layouts[0].is_covered & layouts[1].is_covered, self._params.match
        disparity = match_columns(top, bottom, self._search, match, is_usable, self._jobs)
        distance_m = self._params.blend.distance_m
        per_m = 1.0 / distance_m if distance_m else 0.0
        above, below = ((layout.owner, layout.centers) for layout in layouts)
        ranged = range_from_disparity(disparity, self._layouts.baseline_m, match, (above, below), per_m)
        return [in_own_directions(*ranged, above, per_m)]


Shown = tuple[NDArray[np.int8], Floats]  # which camera shows a pixel (H, W), -1 none; where they stand (N, 3) in m


def disparities_of_ranges(window: Spherical, baseline_m: float, params: MatchParams) -> Search:
    """Return the disparities, in px, of everything from the nearest range wanted to beyond all."""
    largest = np.arcsin(min(baseline_m / params.nearest_m, 1.0))
    per_radian = window.full_width / (2 * np.pi)
    return Search(-RECTIFIED_PX, float(largest) * per_radian, window.is_whole, window.full_width)


def range_from_disparity(
    disparity: Disparity,
    baseline_m: float,
    params: MatchParams,
    shown: tuple[Shown, Shown] | None = None,
    per_m: float = 0.0,
) -> tuple[Floats, Floats]:
    """Return range from the centre of the upper sphere and its deviation (H, W) in m, NaN where not trusted.

    shown: by which cameras, of the upper and the lower sphere; they are never mounted exactly in their centres; None:
    they are. per_m: 1 over the distance for which their images were joined. Ranges are those of what the pixels show.
    """
    range_m, std_m = np.empty_like(disparity.value), np.empty_like(disparity.value)
    limits = tuple(map(np.float32, (params.max_relative_std, MIN_RANGE_SHARE * params.nearest_m, FAR_M)))
    axes, centered = axes_of(range_m.shape), (np.zeros(range_m.shape, np.int8), np.zeros((1, 3), np.float32))
    shown = shown or (centered, centered)
    lengths = np.float32(baseline_m), np.float32(per_m)
    triangulate(disparity.value, disparity.std, axes, shown, *lengths, limits, range_m, std_m)
    return range_m, std_m


def in_own_directions(range_m: Floats, std_m: Floats, shown: Shown, per_m: float) -> tuple[Floats, Floats]:
    """Return range and deviation (H, W) from the sphere's centre in the pixels' own directions.

    per_m: 1 over the distance for which the images were joined; what is elsewhere, pixels show beside its direction.
    """
    moved, moved_std = np.empty_like(range_m), np.empty_like(std_m)
    recenter(range_m, std_m, *shown, *axes_of(range_m.shape), np.float32(per_m), moved, moved_std)
    return moved, moved_std
