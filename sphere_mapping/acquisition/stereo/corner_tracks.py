"""Corners followed through a few instants of a rectified pair: by patches that are shifted, then by patches of planes.

What a patch's plane does in another image follows from its disparity, which slopes as the plane does, and from the
motion; that of the first corners is good enough. A patch that is only shifted is found where its strongest edges fit,
not where its middle went: of what lies at a slant the near side moves more than the far side, which has the finer
edges. Gain and bias of each patch are free; it is found to a hundredth of a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from sphere_mapping.acquisition.constants import (
    FIT_STEPS,
    HALF_PATCH_PX,
    LAST_STEP_PX,
    LEAST_TEXTURE,
    MAX_SHIFT_PX,
    MAX_SLOPE,
    MIN_MATCHES,
    NEAR_DISPARITY_PX,
)
from sphere_mapping.acquisition.stereo.stereo_field import corners_of, follow
from sphere_mapping.acquisition.stereo.track_fit import Window, motions_of
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats

OFFSETS = np.argwhere(np.ones((2 * HALF_PATCH_PX + 1,) * 2))[:, ::-1].astype(np.float64) - HALF_PATCH_PX  # (M, 2) px


def spline_of(image: Bytes) -> Floats:
    """Return the cubic spline of a grey image."""
    return np.asarray(spline_filter(image.astype(np.float32), 3, np.float32, mode="mirror"), np.float32)


def sample_bilinear(spline: Floats, pixels: Array) -> Array:
    """Return grey levels (...) at pixels (..., 2) by (u, v)."""
    at = np.moveaxis(pixels, -1, 0)[::-1]
    return np.asarray(map_coordinates(spline, at, np.float64, 3, "mirror", prefilter=False), np.float64)


@dataclass(frozen=True, eq=False)
class Patches:
    """N patches of M pixels: grey levels (N, M) and their slopes (N, M, 2) by u, v."""

    levels: Array
    slopes: Array


def cut_patches(spline: Floats, pixels: Array) -> Patches:
    """Return the patches around pixels (N, 2)."""
    side = np.arange(-HALF_PATCH_PX - 1, HALF_PATCH_PX + 2)
    grid = np.stack(np.meshgrid(side, side), axis=-1)
    wide: Array = sample_bilinear(spline, pixels[:, None, None] + grid)
    inner = (slice(None), slice(1, -1), slice(1, -1))
    slopes = np.stack([np.asarray(np.gradient(wide, axis=axis))[inner] for axis in (2, 1)], axis=-1)
    return Patches(wide[inner].reshape(len(pixels), -1), slopes.reshape(len(pixels), -1, 2))


def warps_of(camera: Pinhole, pixels: Array, inverse: Array, slopes: Array, T_other_this: SE3) -> tuple[Array, Array]:
    """Return where the pixels of patches go around their middles (N, M, 2), and its derivative in the middle (N, 2, 2).

    inverse (N,): inverse depth in 1/m of the middles. slopes (N, 2): its change by pixels.
    """
    f = np.array([camera.fx, camera.fy])
    middle = np.column_stack([(pixels - (camera.cx, camera.cy)) / f, np.ones(len(pixels))])
    R, t = T_other_this.rotation, T_other_this.translation
    p = middle @ R.T + t * inverse[:, None]
    by = (R[:, :2] / f)[None] + t[:, None] * slopes[:, None, :]  # (N, 3, 2)
    q = p[:, None] + np.einsum("nij,mj->nmi", by, OFFSETS)
    warps = camera.project(q)[0] - camera.project(p)[0][:, None]
    return warps, camera.J_project(p) @ by


def find_patches(
    patches: Patches, other: Floats, start: Array, warps: Array, derivative: Array, *, is_slanted: bool
) -> tuple[Array, Array, Flags]:
    """Return the pixels (N, 2) of the patches' middles in another image, slopes (N, 2), and which were found.

    warps, derivative: as of `warps_of`. is_slanted: the slopes, how much farther right by pixels, are found, too.
    """
    pull = _pull(patches, derivative, is_slanted)
    found, slopes = start.copy(), np.zeros((len(start), 2))
    limits = np.array(other.shape[::-1]) - 1.0
    reach = np.array([1.0, 1.0, HALF_PATCH_PX, HALF_PATCH_PX])  # px that the border of a patch moves by a step of 1
    is_found = np.zeros(len(start), np.bool_)
    active = np.flatnonzero(np.isfinite(start).all(axis=1) & np.isfinite(warps).all(axis=(1, 2)))
    for _ in range(FIT_STEPS):
        at = found[active, None] + warps[active]
        at[..., 0] += slopes[active] @ OFFSETS.T
        step = np.einsum("npm,nm->np", pull[active], sample_bilinear(other, at))
        found[active] -= step[:, :2]
        slopes[active] -= step[:, 2:] if is_slanted else 0.0
        is_near = np.abs(found[active] - start[active]).max(axis=1) < MAX_SHIFT_PX
        is_near &= np.abs(slopes[active]).max(axis=1) < MAX_SLOPE
        is_near &= np.all((at >= 0) & (at <= limits), axis=(1, 2))
        is_still = np.abs(step * reach[: step.shape[1]]).max(axis=1) < LAST_STEP_PX
        is_found[active[is_near & is_still]] = True
        active = active[is_near & ~is_still]
        if not len(active):
            break
    return found, slopes, is_found


def _pull(patches: Patches, derivative: Array, is_slanted: bool) -> Array:
    """Return (N, 2 or 4, M): what grey levels say of the step, whatever their gain and bias."""
    safe = np.where(np.isfinite(derivative).all(axis=(1, 2), keepdims=True), derivative, np.eye(2))
    J = patches.slopes @ np.linalg.pinv(safe)  # by pixels of the other image
    if is_slanted:
        J = np.concatenate([J, J[..., :1] * OFFSETS], axis=-1)
    J = J - J.mean(axis=1, keepdims=True)
    level = patches.levels - patches.levels.mean(axis=1, keepdims=True)
    level = level / np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-6)
    J = J - level[..., None] * np.einsum("nm,nmp->np", level, J)[:, None]
    normal = np.einsum("nmp,nmq->npq", J, J) + LEAST_TEXTURE * np.eye(J.shape[-1])
    return np.asarray(np.linalg.solve(normal, np.swapaxes(J, 1, 2)), np.float64)


def follow_window(camera: Pinhole, baseline_m: float, lefts: Sequence[Bytes], rights: Sequence[Bytes]) -> Window | None:
    """Return the corners seen in two grey images or more of consecutive instants, None where they are too few.

    Near ones are soon lost by a fast drive, and tell most.
    """
    shifted = follow_shifted(lefts, rights)
    return None if shifted is None else follow_planes(camera, baseline_m, lefts, rights, shifted)


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
        seen &= found & (disparity > NEAR_DISPARITY_PX) & (np.abs(at - there)[:, 1] < MAX_SHIFT_PX)
        left[k, seen], right_u[k, seen] = at[seen], there[seen, 0]
    return _long_enough(left, right_u)


def follow_planes(
    camera: Pinhole, baseline_m: float, lefts: Sequence[Bytes], rights: Sequence[Bytes], shifted: Window
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
    """Return the corners seen in two instants or more, as a motion needs; instants with too few are cut off."""
    number = int(np.cumprod((~np.isnan(right_u)).sum(axis=1) >= MIN_MATCHES).sum())
    if number < 2:
        return None
    followed = ~np.isnan(right_u[1])
    return Window(left[:number, followed], right_u[:number, followed])
