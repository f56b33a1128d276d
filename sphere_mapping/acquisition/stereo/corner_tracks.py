"""Corners followed through a few instants of a rectified pair: by patches that are shifted, then by patches that bend.

A patch that is only shifted is found where its strongest edges fit, not where its middle went: of what lies at a slant
the near side moves more than the far side, which has the finer edges. So all that a small plane can do in an image,
shift and bend (six numbers), is found, whatever its gain and bias: the middle to a hundredth of a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from sphere_mapping.acquisition.constants import (
    HALF_PATCH_PX,
    LAST_STEP_PX,
    LEAST_TEXTURE,
    MAX_BEND,
    MAX_OFF_ROW_PX,
    MAX_SHIFT_PX,
    MIN_TRACKS,
    MIN_VIEWS,
    NEAR_DISPARITY_PX,
    PATCH_STEPS,
)
from sphere_mapping.acquisition.stereo.stereo_field import corners_of, follow
from sphere_mapping.acquisition.stereo.track_fit import Window
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats

OFFSETS = np.argwhere(np.ones((2 * HALF_PATCH_PX + 1,) * 2))[:, ::-1].astype(np.float64) - HALF_PATCH_PX  # (M, 2) px


def spline_of(image: Bytes) -> Floats:
    """Return the cubic spline of a grey image."""
    return np.asarray(spline_filter(image.astype(np.float32), 3, np.float32, mode="mirror"), np.float32)


def sample(spline: Floats, pixels: Array) -> Array:
    """Return grey levels (...) at pixels (..., 2) by (u, v)."""
    at = np.moveaxis(pixels, -1, 0)[::-1]
    return np.asarray(map_coordinates(spline, at, np.float64, 3, "mirror", prefilter=False), np.float64)


def pull_of(image: Bytes, pixels: Array) -> Array:
    """Return (N, 6, M): what M grey levels of the patches around pixels (N, 2) say of a step, whatever gain and bias.

    A step is a shift by u, v; what each offset to the right adds to u, v; what each offset down adds.
    """
    side = np.arange(-HALF_PATCH_PX - 1, HALF_PATCH_PX + 2)
    wide: Array = sample(spline_of(image), pixels[:, None, None] + np.stack(np.meshgrid(side, side), axis=-1))
    level, *slopes = (
        np.asarray(plane)[:, 1:-1, 1:-1].reshape(len(pixels), -1)
        for plane in (wide, np.gradient(wide, axis=2), np.gradient(wide, axis=1))
    )
    J = np.stack([slope * by for by in (1.0, *OFFSETS.T) for slope in slopes], axis=-1)
    J = J - J.mean(axis=1, keepdims=True)
    level = level - level.mean(axis=1, keepdims=True)
    level = level / np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-6)
    J = J - level[..., None] * np.einsum("nm,nmp->np", level, J)[:, None]
    normal = np.einsum("nmp,nmq->npq", J, J) + LEAST_TEXTURE * np.eye(J.shape[-1])
    return np.asarray(np.linalg.solve(normal, np.swapaxes(J, 1, 2)), np.float64)


def find_patches(pull: Array, image: Bytes, start: Array) -> tuple[Array, Flags]:
    """Return the pixels (N, 2) of the patches' middles in another image, and which were found; pull: of `pull_of`."""
    spline, limits = spline_of(image), np.array(image.shape[::-1]) - 1.0
    found, bend, is_found = start.copy(), np.tile(np.eye(2), (len(start), 1, 1)), np.zeros(len(start), np.bool_)
    active = np.flatnonzero(np.isfinite(start).all(axis=1))
    for _ in range(PATCH_STEPS):
        at = found[active, None] + OFFSETS @ bend[active]
        step = np.einsum("npm,nm->np", pull[active], sample(spline, at))
        shift, change = step[:, None, :2], step[:, 2:].reshape(-1, 2, 2)
        bend[active] -= change @ bend[active]
        found[active] -= (shift @ bend[active])[:, 0]
        is_near = np.abs(found[active] - start[active]).max(axis=1) < MAX_SHIFT_PX
        is_near &= np.abs(bend[active] - np.eye(2)).max(axis=(1, 2)) < MAX_BEND
        is_near &= np.all((at >= 0) & (at <= limits), axis=(1, 2))
        of_border = np.concatenate([step[:, :2], HALF_PATCH_PX * step[:, 2:]], axis=1)
        is_still = np.abs(of_border).max(axis=1) < LAST_STEP_PX
        is_found[active[is_near & is_still]] = True
        active = active[is_near & ~is_still]
    return found, is_found


def follow_window(lefts: Sequence[Bytes], rights: Sequence[Bytes]) -> Window | None:
    """Return the corners seen in two grey images or more of consecutive instants, None where they are too few.

    Near ones are soon lost by a fast drive, and tell most.
    """
    shifted = follow_shifted(lefts, rights)
    if shifted is None:
        return None
    pull, seen = pull_of(lefts[0], shifted.left[0]), np.ones(len(shifted.left[0]), np.bool_)
    left, right_u = np.full_like(shifted.left, np.nan), np.full_like(shifted.right_u, np.nan)
    for k in range(len(left)):
        at, there = shifted.left[k].copy(), np.column_stack([shifted.right_u[k], shifted.left[k, :, 1]])
        for image, place in ((lefts[k], at), (rights[k], there)):
            place[:], found = find_patches(pull, image, place)
            seen &= found
        left[k, seen], right_u[k, seen] = at[seen], there[seen, 0]
    return _long_enough(left, right_u)


def follow_shifted(lefts: Sequence[Bytes], rights: Sequence[Bytes]) -> Window | None:
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


def _long_enough(left: np.ndarray, right_u: np.ndarray) -> Window | None:
    """Return the corners seen in MIN_VIEWS instants or more; instants with too few are cut off."""
    number = int(np.cumprod((~np.isnan(right_u)).sum(axis=1) >= MIN_TRACKS).sum())
    if number < MIN_VIEWS:
        return None
    followed = ~np.isnan(right_u[MIN_VIEWS - 1])
    return Window(left[:number, followed], right_u[:number, followed])
