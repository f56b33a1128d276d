"""How much the image resembles a key sphere, seen from many poses at once: their correlation (M15 section 5.4).

Nothing is aligned here: a few hundred points of the sphere are projected from each pose into a coarse image.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photometric.pyramid import Level
from sphere_geometry import SE3

Array = NDArray[np.float64]
MIN_VISIBLE = 20  # points below which nothing is said


def resemblance(
    points: NDArray[np.floating], intensity: NDArray[np.floating], T_camera_sphere: SE3, level: Level
) -> Array:
    """Return for each of G poses the correlation, weakened where few points are seen; -1 where too few.

    points (N, 3) m and intensity (N,) of the sphere, T_camera_sphere a batch of G, the image at one level.
    """
    pixels, is_visible = level.camera.project(T_camera_sphere.apply(points.astype(np.float64)))
    u, v = (np.nan_to_num(axis) for axis in np.moveaxis(pixels, -1, 0))
    column = np.clip(np.rint(u), 0, level.camera.width - 1).astype(np.int64) + level.pad
    row = np.clip(np.rint(v), 0, level.camera.height - 1).astype(np.int64)
    seen = np.where(is_visible, level.image[row, column], 0.0)
    known = np.where(is_visible, intensity, 0.0)
    count = np.count_nonzero(is_visible, axis=1)
    safe = np.maximum(count, 1)
    mean_seen, mean_known = seen.sum(axis=1) / safe, known.sum(axis=1) / safe
    product = np.einsum("gn,gn->g", seen, known) / safe - mean_seen * mean_known
    variance_seen = np.einsum("gn,gn->g", seen, seen) / safe - mean_seen**2
    variance_known = np.einsum("gn,gn->g", known, known) / safe - mean_known**2
    ncc = product / np.sqrt(np.maximum(variance_seen * variance_known, 1e-6))
    return np.where(count >= MIN_VISIBLE, ncc * np.sqrt(count / points.shape[0]), -1.0)
