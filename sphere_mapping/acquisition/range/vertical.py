"""Range of a rig of two levels: a top and a bottom sphere, matched along their columns (M15 section 4.3)."""

from __future__ import annotations

from collections.abc import Mapping

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.epipolar import disparities_of_ranges, in_own_directions, range_from_disparity
from sphere_mapping.acquisition.range.fusion import Ranged
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.semi_global import check_order, in_threads
from sphere_mapping.acquisition.stitching.blending import blend
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_nav.geometry.arrays import Bytes

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
