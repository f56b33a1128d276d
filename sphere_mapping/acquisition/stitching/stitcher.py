"""READ FIRST. The images of a rig at one instant -> an augmented sphere (M15 section 4.3).

Exposures are made equal; the cameras of the top level are joined to a sphere, those of the bottom level to another;
disparity along their columns gives range; the image is joined once more, every pixel taken from where its point is
seen. A rig of one level finds its range in pairs of neighbours. A camera that is missing leaves a hole.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.light.light import Learned, Light
from sphere_mapping.acquisition.params import RectifyParams, StitchParams
from sphere_mapping.acquisition.range.epipolar import (
    baseline_error,
    centre_of,
    correct_baseline,
    range_from_below,
    range_from_disparity,
    search_of,
    sphere_frame,
    to_common_centre,
)
from sphere_mapping.acquisition.range.fusion import (
    Ranged,
    fill,
    fill_unknown,
    fuse_sources,
    range_from_cloud,
    range_from_depth,
)
from sphere_mapping.acquisition.range.lens_check import check_lenses
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.pairs import pairs_of, range_of_pairs, why_no_pair
from sphere_mapping.acquisition.range.planes import Places, range_of_planes
from sphere_mapping.acquisition.range.plausibility import check_order
from sphere_mapping.acquisition.range.rectification import matches_of
from sphere_mapping.acquisition.range.rig_adjustment import Matches
from sphere_mapping.acquisition.stitching.blending import blend
from sphere_mapping.acquisition.stitching.views import Layout, RigView, border_of, layout_of
from sphere_nav.geometry import SE3, Rig, Spherical
from sphere_nav.spheres.sphere import Sphere, check_depth, check_image, to_grey_bytes

Image = NDArray[np.uint8]
LEAST_KNOWN = 0.005  # share with range below which it moves nothing: what is known is right, but far from the most
MAX_LAYOUTS = 8  # sets of cameras whose tables are kept


@dataclass(frozen=True, eq=False)
class Stitched:
    """The sphere of an instant; the bottom sphere where the rig has one; the cameras that were missing."""

    sphere: Sphere
    bottom: Image | None
    missing: tuple[str, ...]
    gains: dict[str, NDArray[np.float64]]


class Stitcher:
    """Holds the tables of a rig. `T_rig_sphere` is where its spheres are; `jobs` threads change nothing but time.

    `warning`: why there will be no range from stereo, empty where there will be.
    """

    def __init__(
        self, rig: Rig, params: StitchParams | None = None, masks: Mapping[str, Image] | None = None, jobs: int = 1
    ) -> None:
        self.rig, self.params, self.jobs = rig, params or StitchParams(), jobs
        align = max(64, 2 << self.params.blend.num_bands)
        if self.params.width % align:
            raise ValueError(f"stitch.width: expected a multiple of {align}, found {self.params.width}")
        self.whole = Spherical(self.params.width, self.params.width // 2)
        self.T_rig_sphere, self.baseline_m = sphere_frame(rig)
        self.masks = masks = dict(masks or {})
        self._rig_views = {
            part.name: RigView(
                part.name,
                part.camera,
                self.T_rig_sphere.inverse() @ part.T_rig_camera,
                border_of(part, masks.get(part.name)),
            )
            for part in rig.cameras
        }
        groups = {part.name: part.exposure_group or f"alone {part.name}" for part in rig.cameras}
        blend, views = self.params.blend, list(self._rig_views.values())
        self._light = Light(views, groups, blend.distance_m, blend.max_gain) if blend.has_gains else None
        self._has_order, self._has_lenses = False, False
        self._layouts: dict[tuple[str, tuple[str, ...]], Layout] = {}
        self._baseline_errors: dict[tuple[str, ...], NDArray[np.float32]] = {}
        is_searched = self.params.range != "none" and not rig.is_vertical
        self.pairs = pairs_of(rig, self._rig_views, self.whole, self.params) if is_searched else []
        self.warning = why_no_pair(rig, self._rig_views) if is_searched and not self.pairs else ""

    @property
    def is_settled(self) -> bool:
        """Whether it has learned and checked all that it will: an instant then depends on nothing before."""
        has_checked = self.params.range == "none" or (
            self._has_lenses and (self._has_order or not self.rig.is_vertical)
        )
        return has_checked and (self._light is None or self._light.is_settled)

    @property
    def learned(self) -> Learned | None:
        """What it has learned of the light, for `resume`."""
        return self._light.learned if self._light is not None else None

    def resume(self, learned: Learned | None) -> None:
        """Go on where another stitcher of the rig, that had settled, was."""
        self._has_order = self._has_lenses = True
        if self._light is not None and learned is not None:
            self._light.resume(learned)

    def stitch(
        self,
        images: Mapping[str, Image],
        stamp_ns: int = 0,
        points_rig: NDArray[np.floating] | None = None,
        depths: Mapping[str, NDArray[np.floating]] | None = None,
    ) -> Stitched:
        """Return the sphere of one instant from the images by camera, all grey or all RGB; cameras may be missing.

        points_rig (N, 3): a LiDAR's cloud of the instant in the frame of the rig. depths: of RGB-D cameras, (h, w) m
        along the axis, registered to the image.
        """
        found, gains = self.equalize(images)
        greys = {name: to_grey_bytes(image) for name, image in found.items()}
        sources, planes, bottom = self._ranges(greys)  # names exchanged levels, before lenses are blamed for them
        if not self._has_lenses and self.params.range != "none":  # once is enough: lenses do not change
            check_lenses(self.rig, greys)
            self._has_lenses = True
        for name, depth_m in (depths or {}).items():
            check_depth(depth_m, self.rig.camera(name).camera, f"{name}: depth")
            sources.append(range_from_depth(depth_m, self._rig_views[name], self.whole, self.params.fusion))
        if points_rig is not None:
            points_sphere = self.T_rig_sphere.inverse().apply(np.asarray(points_rig, dtype=np.float64))
            sources.append(range_from_cloud(points_sphere, self.whole, self.params.fusion))
        layout = self.layout("top" if self.rig.is_vertical else "", tuple(found))
        nothing = np.full((self.whole.height, self.whole.width), np.nan, np.float32)
        range_m, std_m = fuse_sources(sources) if sources else (nothing, nothing.copy())
        is_filled = fill_unknown((range_m, std_m), planes) if planes is not None else None
        image = blend(layout, found, self.inverse_of(range_m, layout))
        range_m[~layout.is_covered] = np.nan
        std_m[~np.isfinite(range_m)] = np.nan
        if is_filled is not None:
            is_filled &= layout.is_covered
        missing = tuple(name for name in self.rig.names if name not in found)
        return Stitched(Sphere(image, range_m, self.whole, stamp_ns, std_m, is_filled), bottom, missing, gains)

    def matches(
        self, images: Mapping[str, Image], params: RectifyParams, points_rig: NDArray[np.floating] | None = None
    ) -> list[Matches]:
        """Return the features that cameras share at one instant, for `rectified`; points_rig as for `stitch`."""
        greys = {name: to_grey_bytes(image) for name, image in self.equalize(images)[0].items()}
        points = None if points_rig is None else self.T_rig_sphere.inverse().apply(np.asarray(points_rig, np.float64))
        return matches_of(list(self._rig_views.values()), greys, params, points)

    def layout(self, level: str, present: tuple[str, ...]) -> Layout:
        """Return the views of a level's cameras that are present; ValueError if there are none."""
        names = tuple(part.name for part in self.rig.at_level(level) if part.name in present)
        if not names:
            raise ValueError(f"rig {self.rig.name}: expected an image of a {level or 'rig'} camera, found none")
        if (level, names) not in self._layouts:
            if len(self._layouts) >= MAX_LAYOUTS:
                del self._layouts[next(iter(self._layouts))]
            rig_views = [self._view_at(self._rig_views[name], level) for name in names]
            blend = self.params.blend
            layout = layout_of(rig_views, self.whole, blend.distance_m, blend.num_bands)
            self._layouts[level, names] = layout if blend.has_gains else replace(layout, seams=())
        return self._layouts[level, names]

    def _view_at(self, rig_view: RigView, level: str) -> RigView:
        """Return the rig_view as seen from the centre of its level."""
        if level != "bottom":
            return rig_view
        centre = self.T_rig_sphere.inverse().apply(centre_of(self.rig.at_level("bottom"))[None])[0]
        moved = SE3.from_parts(rig_view.T_sphere_camera.rotation, rig_view.T_sphere_camera.translation - centre)
        return RigView(rig_view.name, rig_view.camera, moved, rig_view.border)

    def equalize(self, images: Mapping[str, Image]) -> tuple[dict[str, Image], dict[str, NDArray[np.float64]]]:
        """Return the checked images with their exposures made equal, in the order of the rig, and the gains."""
        if not images:
            raise ValueError(f"rig {self.rig.name}: expected at least one image, found none")
        for name, image in images.items():
            check_image(image, self.rig.camera(name).camera, f"{name}: image")
        kinds = {image.ndim for image in images.values()}
        if len(kinds) > 1:
            raise ValueError(f"rig {self.rig.name}: images: expected all grey or all RGB, found both")
        ordered = {name: images[name] for name in self.rig.names if name in images}
        if self._light is None:
            return ordered, {name: np.ones(1) for name in ordered}
        return self._light.balance(ordered)

    def _ranges(self, greys: dict[str, Image]) -> tuple[list[Ranged], Ranged | None, Image | None]:
        """Return what the cameras say about range, that of bare planes, and the bottom sphere of a vertical rig."""
        if self.params.range == "none":
            return [], None, None
        if not self.rig.is_vertical:
            pairs = [pair for pair in self.pairs if pair.first in greys and pair.second in greys]
            return [range_of_pairs(pairs, greys, self.whole, self.params, self.jobs)] if pairs else [], None, None
        if not any(part.name in greys for part in self.rig.at_level("bottom")):
            return [], None, None
        layouts = [self.layout(level, tuple(greys)) for level in ("top", "bottom")]
        top, bottom = self._levels(layouts, greys)
        ranged, distance_m = self._match(layouts, top, bottom), self.params.blend.distance_m
        error = self._baseline_error(layouts, tuple(greys))
        correct_baseline(*ranged, error, distance_m)
        per_m = 1.0 / distance_m if distance_m else 0.0
        places = Places(self.baseline_m, layouts[0].owner, layouts[0].centres, error, per_m)
        planes = self._planes(layouts, top, bottom, ranged, places)
        ranged, planes = _to_common_centre(ranged, planes, layouts[0])
        for _ in range(self.params.blend.num_passes - 1):
            top, bottom = self._levels(layouts, greys, ranged[0])
            ranged = self._match(layouts, top, bottom)
        return [ranged], planes, bottom

    def _planes(
        self, layouts: list[Layout], top: Image, bottom: Image, ranged: Ranged, places: Places
    ) -> Ranged | None:
        """Return the range of bare planes from the cameras' places, None where it is not wanted."""
        if not self.params.has_planes:
            return None
        is_usable, match = layouts[0].is_covered & layouts[1].is_covered, self.params.match
        search = search_of(self.whole, self.baseline_m, match)
        return range_of_planes(top, bottom, ranged, is_usable, places, search, match)

    def _baseline_error(self, layouts: list[Layout], present: tuple[str, ...]) -> NDArray[np.float32]:
        """Return what the cameras that are present change in the baseline of each pixel (H, W)."""
        if present not in self._baseline_errors:
            if len(self._baseline_errors) >= MAX_LAYOUTS:
                del self._baseline_errors[next(iter(self._baseline_errors))]
            self._baseline_errors[present] = baseline_error(layouts, self.baseline_m)
        return self._baseline_errors[present]

    def _match(self, layouts: list[Layout], top: Image, bottom: Image) -> Ranged:
        """Return range from the upper centre."""
        if not self._has_order:  # once is enough: the cameras stay where they are
            check_order(top, bottom, ("top", "bottom"), is_whole=True)
            self._has_order = True
        is_usable = layouts[0].is_covered & layouts[1].is_covered
        search = search_of(self.whole, self.baseline_m, self.params.match)
        disparity = match_columns(top, bottom, search, self.params.match, is_usable, self.jobs)
        return range_from_disparity(disparity, self.whole, self.baseline_m, self.params.match)

    def top_and_bottom(
        self, images: Mapping[str, Image], range_m: NDArray[np.float32] | None = None
    ) -> tuple[Image, Image]:
        """Return the two grey spheres (H, W) that are matched, with range as their centres see them."""
        found, _ = self.equalize(images)
        greys = {name: to_grey_bytes(image) for name, image in found.items()}
        return self._levels([self.layout(level, tuple(greys)) for level in ("top", "bottom")], greys, range_m)

    def _levels(
        self, layouts: list[Layout], greys: Mapping[str, Image], range_m: NDArray[np.float32] | None = None
    ) -> tuple[Image, Image]:
        """Return both grey spheres: of a common distance, or of the range that the top one has."""
        inverses: list[NDArray[np.float32] | None] = [None, None]
        if range_m is not None and (inverse := self.inverse_of(range_m, layouts[0])) is not None:
            above = (1.0 / np.maximum(inverse, 1e-4)).astype(np.float32)
            below = range_from_below(above, self.whole, self.baseline_m)
            inverses = [inverse, self.inverse_of(below, layouts[1])]
        with ThreadPoolExecutor(self.jobs) as pool:
            top, bottom = pool.map(lambda pair: blend(pair[0], greys, pair[1]), zip(layouts, inverses, strict=True))
        return top, bottom

    def inverse_of(self, range_m: NDArray[np.float32], layout: Layout) -> NDArray[np.float32] | None:
        """Return 1 / range everywhere, from known pixels around where unknown; None where too little is known."""
        known = ~np.isnan(range_m)
        share = np.count_nonzero(known) / max(int(np.count_nonzero(layout.is_covered)), 1)
        if not known.any() or share < LEAST_KNOWN:
            return None
        with np.errstate(divide="ignore"):
            inverse = fill((1.0 / range_m).astype(np.float32), known)
        return cv2.medianBlur(inverse, 5)


def _to_common_centre(ranged: Ranged, planes: Ranged | None, layout: Layout) -> tuple[Ranged, Ranged | None]:
    """Return what is measured, and what planes say elsewhere, as from the sphere's centre."""
    if planes is None:
        return to_common_centre(*ranged, layout), None
    is_filled = np.flatnonzero(~np.isnan(planes[0]))
    for values, others, sign in zip(ranged, planes, (1.0, -1.0), strict=True):
        np.put(values, is_filled, np.float32(sign) * others.take(is_filled))  # the minus sign takes the mark along
    measured = to_common_centre(*ranged, layout)
    is_filled = np.flatnonzero(measured[1] < 0)
    filled = np.full_like(measured[0], np.nan), np.full_like(measured[1], np.nan)
    for values, others, sign in zip(filled, measured, (1.0, -1.0), strict=True):
        np.put(values, is_filled, np.float32(sign) * others.take(is_filled))
        np.put(others, is_filled, np.float32(np.nan))
    return measured, filled
