"""Cameras that stand side by side: every pair is rectified about its own baseline, matched, and seen from the sphere.

The two views are turned into spheres whose poles lie on the baseline, as the two levels of a vertical rig are; a point
then has the same column in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    AGREEMENT_SIGMAS,
    HALF_VIEW_DEG,
    MIN_BASELINE_M,
    MIN_SHARED_VIEW,
    MIN_VOTES,
    PAIR_EDGE_PX,
    VERY_FAR_M,
    VIEW_GRID,
)
from sphere_mapping.acquisition.kernels import count_votes, mean_of_window, place_window
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.epipolar import disparities_of_ranges, range_from_disparity
from sphere_mapping.acquisition.range.fusion import Ranged, StereoRange, fuse_planes
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.semi_global import in_threads
from sphere_mapping.acquisition.stitching.layouts import Layouts, upright
from sphere_mapping.acquisition.stitching.views import RigView
from sphere_nav.geometry import SE3, Rig, RigCamera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two cameras in a window of a sphere around the first; T_sphere_pair takes its frame to the rig's sphere."""

    first: str
    second: str
    window: Spherical
    T_sphere_pair: SE3
    baseline_m: float
    tables: tuple[tuple[NDArray, NDArray], tuple[NDArray, NDArray]]
    is_usable: NDArray[np.bool_]
    rays: NDArray[np.float32]  # (h, w, 3), in the frame of the sphere
    pixels: NDArray[np.float32]  # (h, w, 2), where the sphere has them
    sees: Flags  # (H, W), which directions of the sphere both cameras see


class PairwiseStereo:
    """Range of a rig of one level. `warning`: why there will be none, empty where there will be."""

    is_checked = True  # there is no order to check

    def __init__(self, layouts: Layouts, params: StitchParams, jobs: int) -> None:
        self._whole, self._params, self._jobs = layouts.whole, params, jobs
        self.pairs = pairs_of(layouts.rig, layouts.views, layouts.whole, params)
        self.warning = "" if self.pairs else why_no_pair(layouts.rig, layouts.views)

    def find(self, grays: dict[str, Image]) -> StereoRange:
        """Return the range from the grey images of one instant, by camera."""
        pairs = [pair for pair in self.pairs if pair.first in grays and pair.second in grays]
        if not pairs:
            return StereoRange()
        return StereoRange([range_of_pairs(pairs, grays, self._whole, self._params, self._jobs)])


def pairs_of(rig: Rig, rig_views: dict[str, RigView], whole: Spherical, params: StitchParams) -> list[Pair]:
    """Return the pairs of cameras of a rig of one level that stand apart and see enough in common."""
    found = []
    for a, b in combinations(rig.cameras, 2):
        apart = float(np.linalg.norm(a.T_rig_camera.translation - b.T_rig_camera.translation))
        if apart >= MIN_BASELINE_M["side"] and shared_view(rig_views[a.name], rig_views[b.name]) >= MIN_SHARED_VIEW:
            pair = _pair(a, b, rig_views, params, whole)
            if pair.is_usable.any():
                found.append(pair)
    return found


def why_no_pair(rig: Rig, rig_views: dict[str, RigView]) -> str:
    """Return in words why `pairs_of` finds none: the pair that comes nearest, and what it lacks."""
    if len(rig.cameras) < 2:
        return f"rig {rig.name}: no range from stereo: expected two cameras, found {len(rig.cameras)}"
    views = combinations(rig.cameras, 2)
    shares = {(a.name, b.name): shared_view(rig_views[a.name], rig_views[b.name]) for a, b in views}
    best = max(shares, key=lambda names: shares[names])
    a, b = (rig.camera(name) for name in best)
    apart = float(np.linalg.norm(a.T_rig_camera.translation - b.T_rig_camera.translation))
    if shares[best] < MIN_SHARED_VIEW:
        lack = f"{MIN_SHARED_VIEW:.0%} of the sphere seen by two cameras, "
        lack += f"found {shares[best]:.1%} at most ({a.name}, {b.name})"
    else:
        lack = f"centres {MIN_BASELINE_M['side']} m apart, found {apart:.3f} m ({a.name}, {b.name})"
    return f"rig {rig.name}: no range from stereo: expected {lack}"


def shared_view(a: RigView, b: RigView) -> float:
    """Return the share of all directions that both cameras see."""
    rays = pixel_rays(VIEW_GRID)
    weight = np.hypot(rays[..., 0], rays[..., 1])  # columns are narrower towards the poles
    both = (a.project(rays * VERY_FAR_M)[2] > 0) & (b.project(rays * VERY_FAR_M)[2] > 0)
    return float(weight[both].sum() / weight.sum())


def _pair(a: RigCamera, b: RigCamera, rig_views: dict[str, RigView], params: StitchParams, whole: Spherical) -> Pair:
    T_sphere_a, T_sphere_b = rig_views[a.name].T_sphere_camera, rig_views[b.name].T_sphere_camera
    along = T_sphere_a.translation - T_sphere_b.translation
    baseline_m = float(np.linalg.norm(along))
    R = upright(along / baseline_m, T_sphere_a.rotation[:, 2] + T_sphere_b.rotation[:, 2])
    window = _window(params)
    rays = pixel_rays(window)
    seen = []
    for T_sphere_camera, rig_view in ((T_sphere_a, rig_views[a.name]), (T_sphere_b, rig_views[b.name])):
        turned = SE3.from_parts(R.T @ T_sphere_camera.rotation, np.zeros(3))
        seen.append(RigView(rig_view.name, rig_view.camera, turned, rig_view.border).project(rays))
    tables = [cv2.convertMaps(part[0], part[1], cv2.CV_16SC2) for part in seen]
    is_usable = (seen[0][2] > 0) & (seen[1][2] > 0)
    T_sphere_pair = SE3.from_parts(R, T_sphere_a.translation)
    rays_sphere = rays @ R.T
    return Pair(
        a.name,
        b.name,
        window,
        T_sphere_pair,
        baseline_m,
        (tables[0], tables[1]),
        is_usable,
        rays_sphere.astype(np.float32),
        whole.project(rays_sphere)[0].astype(np.float32),
        _on_sphere(is_usable, window, R, whole),
    )


def _on_sphere(is_usable: NDArray[np.bool_], window: Spherical, R: NDArray[np.float64], whole: Spherical) -> Flags:
    """Return what is usable in a window whose frame is turned by R, at the pixels (H, W) of the whole sphere."""
    pixels, is_inside = window.project(pixel_rays(whole) @ R)
    u, v = (np.nan_to_num(pixels[..., k], nan=-1e4).astype(np.float32) for k in (0, 1))
    return is_inside & (cv2.remap(is_usable.astype(np.uint8), u, v, cv2.INTER_NEAREST) > 0)


def range_of_pairs(
    pairs: Sequence[Pair], images: dict[str, Image], whole: Spherical, params: StitchParams, jobs: int
) -> Ranged:
    """Return range and deviation (H, W) that pairs give the sphere; images are grey."""
    ranges, stds = (np.empty((len(pairs), whole.height, whole.width), np.float32) for _ in range(2))

    def work(number: int) -> None:
        _range_of_pair(pairs[number], images, params, ranges[number], stds[number])

    in_threads(work, range(len(pairs)), jobs)
    return fuse_pairs(np.stack([pair.sees for pair in pairs]), ranges, stds)


def fuse_pairs(sees: Flags, ranges: Plane, stds: Plane) -> Ranged:
    """Return the range (H, W) that enough of N pairs which see a direction agree on; all (N, H, W).

    A pattern, or an edge before a bare wall, misleads one pair; the next one looks from elsewhere and is misled
    elsewhere, or not at all. The deviation is that of the surest: pairs share cameras, and so errors.
    """
    range_m, std_m = fuse_planes(ranges, stds)
    count_votes(ranges, stds, sees, np.float32(AGREEMENT_SIGMAS), np.float32(MIN_VOTES), range_m, std_m)
    return range_m, std_m


def _range_of_pair(pair: Pair, images: dict[str, Image], params: StitchParams, range_m: Plane, std_m: Plane) -> None:
    """Write range and deviation that a pair gives the sphere to range_m, std_m (H, W)."""
    top, bottom = (
        cv2.remap(images[name], *table, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for name, table in zip((pair.first, pair.second), pair.tables, strict=True)
    )
    search = disparities_of_ranges(pair.window, pair.baseline_m, params.match)
    disparity = match_columns(top, bottom, search, params.match, pair.is_usable, 1, PAIR_EDGE_PX)
    own_m, own_std_m = range_from_disparity(disparity, pair.window, pair.baseline_m, params.match)
    nearest, places = np.full(range_m.shape, np.inf, np.float32), np.empty((3, *own_m.shape), np.float32)
    place_window(own_m, pair.rays, pair.pixels, pair.T_sphere_pair.translation.astype(np.float32), nearest, places)
    sums = np.zeros((*range_m.shape, 4), np.float32)
    mean_of_window(places, own_std_m / own_m, nearest, sums, range_m, std_m)


def _window(params: StitchParams) -> Spherical:
    per_degree = params.width / 360.0
    half_u, half_v = (8 * round(half_deg * per_degree / 8) for half_deg in HALF_VIEW_DEG)
    offset = (params.width / 2 - half_u, params.width / 4 - half_v)
    return Spherical(2 * half_u, 2 * half_v, float(params.width), *offset)
