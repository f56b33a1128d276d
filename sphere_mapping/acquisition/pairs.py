"""Cameras that stand side by side: every pair is rectified about its own baseline, matched, and seen from the sphere.

The two views are turned into spheres whose poles lie on the baseline, as the two levels of a vertical rig are; a point
then has the same column in both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3, Rig, RigCamera, Spherical
from sphere_geometry.camera import pixel_grid
from sphere_mapping.acquisition.epipolar import range_from_disparity, upright
from sphere_mapping.acquisition.fusion import Ranged
from sphere_mapping.acquisition.kernels import splat_window
from sphere_mapping.acquisition.matching import match_columns
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.views import Seat

Image = NDArray[np.uint8]


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


def pairs_of(rig: Rig, seats: dict[str, Seat], whole: Spherical, params: StitchParams) -> list[Pair]:
    """Return the pairs of neighbours of a rig of one level that see enough in common."""
    found = []
    for a, b in combinations(rig.cameras, 2):
        axes = a.T_rig_camera.rotation[:, 2], b.T_rig_camera.rotation[:, 2]
        between = np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1.0, 1.0)))
        apart = float(np.linalg.norm(a.T_rig_camera.translation - b.T_rig_camera.translation))
        if between <= params.pairs.max_between_deg and apart >= params.pairs.min_baseline_m:
            pair = _pair(a, b, seats, params, whole)
            if pair.is_usable.any():
                found.append(pair)
    return found


def _pair(a: RigCamera, b: RigCamera, seats: dict[str, Seat], params: StitchParams, whole: Spherical) -> Pair:
    T_sphere_a, T_sphere_b = seats[a.name].T_sphere_camera, seats[b.name].T_sphere_camera
    along = T_sphere_a.translation - T_sphere_b.translation
    baseline_m = float(np.linalg.norm(along))
    R = upright(along / baseline_m, T_sphere_a.rotation[:, 2] + T_sphere_b.rotation[:, 2])
    window = _window(params)
    rays = window.unproject(pixel_grid(window))
    looks = []
    for T_sphere_camera, seat in ((T_sphere_a, seats[a.name]), (T_sphere_b, seats[b.name])):
        turned = SE3.from_parts(R.T @ T_sphere_camera.rotation, np.zeros(3))
        looks.append(Seat(seat.name, seat.camera, turned, seat.border).look(rays))
    tables = [cv2.convertMaps(look[0], look[1], cv2.CV_16SC2) for look in looks]
    is_usable = (looks[0][2] > 0) & (looks[1][2] > 0)
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
    )


def range_of_pair(pair: Pair, images: dict[str, Image], whole: Spherical, params: StitchParams, jobs: int) -> Ranged:
    """Return range and deviation (H, W) that a pair gives the sphere; images are grey."""
    top, bottom = (
        cv2.remap(images[name], *table, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for name, table in zip((pair.first, pair.second), pair.tables, strict=True)
    )
    match = replace(params.match, edge_px=params.pairs.edge_px if params.match.edge_px else 0)
    disparity = match_columns(top, bottom, pair.window, match, pair.is_usable, jobs)
    range_m, std_m = range_from_disparity(disparity, pair.window, pair.baseline_m, params.match)
    nearest = np.full((whole.height, whole.width), np.inf, np.float32)
    nearest_std = np.full(nearest.shape, np.nan, np.float32)
    offset = pair.T_sphere_pair.translation.astype(np.float32)
    splat_window(range_m, std_m, pair.rays, pair.pixels, offset, nearest, nearest_std)
    nearest[np.isinf(nearest)] = np.nan
    return nearest, nearest_std


def _window(params: StitchParams) -> Spherical:
    per_degree = params.width / 360.0
    half_u = 8 * round(params.pairs.half_width_deg * per_degree / 8)
    half_v = 8 * round(params.pairs.half_height_deg * per_degree / 8)
    offset = (params.width / 2 - half_u, params.width / 4 - half_v)
    return Spherical(2 * half_u, 2 * half_v, float(params.width), *offset)
