"""Evenly spaced points on a sphere (P of M15 eq. 9), chosen from the pixels of its image.

Rows of latitude and longitude have as many pixels at the poles as at the equator: what is above and below counts many
times over, and noise there looks like gradients. Of every row as many are kept as its circle has room for.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_geometry import Camera, Spherical
from sphere_geometry.camera import pixel_grid

ROWS = 64  # that are looked at at once
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0  # of a pixel, by which a row begins after the one above it


def keep_evenly_spaced(ranges: NDArray[np.uint16], camera: Camera) -> None:
    """Forget the ranges (H, W), codes of `kernels.encode_range`, of pixels that a sphere is not sampled at."""
    if isinstance(camera, Spherical):
        is_kept = is_spaced(camera).view(np.uint8)
        for row in range(0, len(ranges), ROWS):
            unknown = np.subtract(is_kept[row : row + ROWS], 1, dtype=np.uint16)  # 0 - 1 is all bits: UNKNOWN
            ranges[row : row + ROWS] |= unknown


@lru_cache(maxsize=16)
def is_spaced(camera: Spherical) -> NDArray[np.bool_]:
    """Return which pixels (H, W) are as far from each other along their row as neighbours at the equator."""
    cosine = np.sqrt(1.0 - camera.unproject(pixel_grid(camera)[:, :1])[..., 2] ** 2)
    first = GOLDEN * np.arange(camera.height)[:, None] % 1.0
    number = np.floor(first + cosine * np.arange(camera.width + 1))  # of those kept before a column
    return np.diff(number, axis=1) > 0
