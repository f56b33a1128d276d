"""Patches of one image found in others to a hundredth of a pixel: each is seen as a plane, and warped as that plane is.

A patch that is only shifted is found where its strongest edges fit, not where its middle went: of what lies at a slant
the near side moves more than the far side, which has the finer edges. Gain and bias of each patch are free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from sphere_mapping.acquisition.constants import (
    HALF_PATCH_PX,
    LAST_STEP_PX,
    LEAST_TEXTURE,
    MAX_SHIFT_PX,
    MAX_SLOPE,
    PATCH_STEPS,
)
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Array

OFFSETS = np.argwhere(np.ones((2 * HALF_PATCH_PX + 1,) * 2))[:, ::-1].astype(np.float64) - HALF_PATCH_PX  # (M, 2) px


def spline_of(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the cubic spline of a grey image."""
    return np.asarray(spline_filter(image.astype(np.float32), 3, np.float32, mode="mirror"), np.float32)


def sample_bilinear(spline: NDArray[np.float32], pixels: Array) -> Array:
    """Return grey levels (...) at pixels (..., 2) by (u, v)."""
    at = np.moveaxis(pixels, -1, 0)[::-1]
    return np.asarray(map_coordinates(spline, at, np.float64, 3, "mirror", prefilter=False), np.float64)


@dataclass(frozen=True, eq=False)
class Patches:
    """N patches of M pixels: pixels (N, 2) of their middles, grey levels (N, M) and their slopes (N, M, 2) by u, v."""

    pixels: Array
    levels: Array
    slopes: Array


def cut_patches(spline: NDArray[np.float32], pixels: Array) -> Patches:
    """Return the patches around pixels (N, 2)."""
    side = np.arange(-HALF_PATCH_PX - 1, HALF_PATCH_PX + 2)
    grid = np.stack(np.meshgrid(side, side), axis=-1)
    wide: Array = sample_bilinear(spline, pixels[:, None, None] + grid)
    inner = (slice(None), slice(1, -1), slice(1, -1))
    slopes = np.stack([np.asarray(np.gradient(wide, axis=axis))[inner] for axis in (2, 1)], axis=-1)
    return Patches(pixels, wide[inner].reshape(len(pixels), -1), slopes.reshape(len(pixels), -1, 2))


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
    at = p[:, :2] / p[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        warps = f * (q[..., :2] / q[..., 2:] - at[:, None])
    return warps, f[:, None] * (by[:, :2] - at[..., None] * by[:, 2:]) / p[:, 2:, None]


def find_patches(
    patches: Patches, other: NDArray[np.float32], start: Array, warps: Array, derivative: Array, *, is_slanted: bool
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the pixels (N, 2) of the patches' middles in another image, slopes (N, 2), and which were found.

    warps, derivative: as of `warps_of`. is_slanted: the slopes, how much farther right by pixels, are found, too.
    """
    pull = _pull(patches, derivative, is_slanted)
    found, slopes = start.copy(), np.zeros((len(start), 2))
    limits = np.array(other.shape[::-1]) - 1.0
    reach = np.array([1.0, 1.0, HALF_PATCH_PX, HALF_PATCH_PX])  # px that the border of a patch moves by a step of 1
    is_found = np.zeros(len(start), np.bool_)
    active = np.flatnonzero(np.isfinite(start).all(axis=1) & np.isfinite(warps).all(axis=(1, 2)))
    for _ in range(PATCH_STEPS):
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
