"""Corners followed through a few instants of a rectified pair: by patches that are shifted, then by patches of planes.

What a patch's plane does in another image follows from its disparity, which slopes as the plane does, and from the
motion; that of the first corners is good enough.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sphere_mapping.acquisition.constants import MAX_OFF_ROW_PX, MIN_TRACKS, MIN_VIEWS, NEAR_DISPARITY_PX
from sphere_mapping.acquisition.stereo.patches import OFFSETS, cut_patches, find_patches, spline_of, warps_of
from sphere_mapping.acquisition.stereo.stereo_field import Image, corners_of, follow
from sphere_mapping.acquisition.stereo.track_fit import Window, motions_of
from sphere_nav.geometry import SE3, Pinhole


def follow_window(camera: Pinhole, baseline_m: float, lefts: Sequence[Image], rights: Sequence[Image]) -> Window | None:
    """Return the corners seen in two grey images or more of consecutive instants, None where they are too few.

    Near ones are soon lost by a fast drive, and tell most.
    """
    shifted = follow_shifted(lefts, rights)
    return None if shifted is None else follow_planes(camera, baseline_m, lefts, rights, shifted)


def follow_shifted(lefts: Sequence[Image], rights: Sequence[Image]) -> Window | None:
    """Return the corners of the first image followed by patches that are only shifted."""
    points = corners_of(lefts[0])
    left, right_u = np.full((len(lefts), len(points), 2), np.nan), np.full((len(lefts), len(points)), np.nan)
    seen, at = np.ones(len(points), np.bool_), points
    for k in range(len(lefts)):
        if k:
            at, found = follow(lefts[k - 1], lefts[k], at)
            seen &= found
        there, found = follow(lefts[k], rights[k], at)
        disparity = at[:, 0] - there[:, 0]
        seen &= found & (disparity > NEAR_DISPARITY_PX) & (np.abs(at - there)[:, 1] < MAX_OFF_ROW_PX)
        left[k, seen], right_u[k, seen] = at[seen], there[seen, 0]
    return _long_enough(left, right_u)


def follow_planes(
    camera: Pinhole, baseline_m: float, lefts: Sequence[Image], rights: Sequence[Image], shifted: Window
) -> Window | None:
    """Return corners anew: the patch of each in the first left image is found in all others as its plane is seen."""
    points, scale = shifted.left[0], 1.0 / (camera.fx * baseline_m)
    patches = cut_patches(spline_of(lefts[0]), points)
    start = np.column_stack([shifted.right_u[0], points[:, 1]])
    flat = np.broadcast_to(OFFSETS, (len(points), *OFFSETS.shape)), np.broadcast_to(np.eye(2), (len(points), 2, 2))
    there, slopes, seen = find_patches(patches, spline_of(rights[0]), start, *flat, is_slanted=True)
    inverse, by_pixels = (points[:, 0] - there[:, 0]) * scale, -slopes * scale
    left, right_u = np.full_like(shifted.left, np.nan), np.full_like(shifted.right_u, np.nan)
    left[0, seen], right_u[0, seen] = points[seen], there[seen, 0]
    T_right_left = SE3.from_parts(np.eye(3), np.array([-baseline_m, 0.0, 0.0]))
    for k, T in enumerate(motions_of(camera, baseline_m, shifted)[1:], start=1):
        at, there = shifted.left[k].copy(), np.column_stack([shifted.right_u[k], shifted.left[k, :, 1]])
        for image, place, motion in ((lefts[k], at, T), (rights[k], there, T_right_left @ T)):
            warps = warps_of(camera, points, inverse, by_pixels, motion)
            place[:], _, found = find_patches(patches, spline_of(image), place, *warps, is_slanted=False)
            seen &= found
        left[k, seen], right_u[k, seen] = at[seen], there[seen, 0]
    return _long_enough(left, right_u)


def _long_enough(left: np.ndarray, right_u: np.ndarray) -> Window | None:
    """Return the corners seen in MIN_VIEWS instants or more; instants with too few are cut off."""
    number = int(np.cumprod((~np.isnan(right_u)).sum(axis=1) >= MIN_TRACKS).sum())
    if number < MIN_VIEWS:
        return None
    followed = ~np.isnan(right_u[MIN_VIEWS - 1])
    return Window(left[:number, followed], right_u[:number, followed])
