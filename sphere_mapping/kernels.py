"""Loops over the pixels of a range image. Plain arrays in, plain arrays out; the callers check shapes."""

from __future__ import annotations

import numpy as np
from numba import config, njit, prange, set_num_threads


@njit(cache=True, nogil=True, parallel=True)
def sample_inverse_depth(inverse, u, v, max_step, sampled):
    """Sample inverse (H, W) f32 at pixels u, v (N,) f32 into sampled (N,) f32, never mixing across a depth edge.

    Bilinear where the four neighbours are measured and differ by at most max_step of the largest (exact on a plane,
    whose inverse depth is linear in a pinhole's pixels), the nearest pixel elsewhere, NaN outside.
    """
    height, width = inverse.shape
    for i in prange(u.size):
        x, y = u[i], v[i]
        if not (x >= -0.5 and x < width - 0.5 and y >= -0.5 and y < height - 0.5):
            sampled[i] = np.nan
            continue
        x0 = min(max(int(np.floor(x)), 0), max(width - 2, 0))
        y0 = min(max(int(np.floor(y)), 0), max(height - 2, 0))
        x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
        a, b, c, d = inverse[y0, x0], inverse[y0, x1], inverse[y1, x0], inverse[y1, x1]
        largest = max(max(a, b), max(c, d))
        spread = largest - min(min(a, b), min(c, d))
        is_measured = not (np.isnan(a) or np.isnan(b) or np.isnan(c) or np.isnan(d))
        if is_measured and spread <= max_step * largest:
            fx, fy = min(max(x - x0, 0.0), 1.0), min(max(y - y0, 0.0), 1.0)
            sampled[i] = (a * (1 - fx) + b * fx) * (1 - fy) + (c * (1 - fx) + d * fx) * fy
        else:
            sampled[i] = inverse[min(int(y + 0.5), height - 1), min(int(x + 0.5), width - 1)]


@njit(cache=True, nogil=True)
def splat_nearest(u, v, range_m, wraps, image):
    """Write each range (N,) f32 to the four pixels of image (H, W) f32 around (u, v), keeping the nearest of all.

    image starts as +Inf where nothing is known. wraps joins the last column to the first.
    """
    height, width = image.shape
    for i in range(u.size):
        if np.isnan(u[i]) or np.isnan(v[i]) or np.isnan(range_m[i]):
            continue
        x0, y0 = int(np.floor(u[i])), int(np.floor(v[i]))
        for y in range(max(y0, 0), min(y0 + 2, height)):
            for dx in range(2):
                x = x0 + dx
                if wraps:
                    x = x % width
                if x >= 0 and x < width and range_m[i] < image[y, x]:
                    image[y, x] = range_m[i]


def use_threads(number: int) -> None:
    """Let parallel kernels run on up to `number` threads; results do not depend on it."""
    set_num_threads(max(1, min(number, config.NUMBA_NUM_THREADS)))


def warm_up() -> None:
    """Compile on tiny arrays, so that the first image does not wait."""
    plane = np.ones((2, 2), dtype=np.float32)
    pixels = np.zeros(1, dtype=np.float32)
    sample_inverse_depth(plane, pixels, pixels, 0.1, np.empty(1, dtype=np.float32))
    splat_nearest(pixels, pixels, pixels, False, plane)
