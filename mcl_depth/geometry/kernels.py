"""The inner loops of depth panoramas: drawing points, expanding LZF. Plain arrays in and out.

Panoramas are (H, W) float32 whose columns wrap around; nothing here may show a seam.
"""

import math
import os

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit, prange
from sphere_nav.photometric.align.iteration.kernels import arctangent2

# Threads that spin while they wait stall every other process of a small vehicle computer; read when a kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


MIN_RANGE = np.float32(1e-3)
MAX_SPLAT = 12.0  # px, half width of the largest drawn point
PI = np.float32(math.pi)


# ---- drawing ----------------------------------------------------------------------------------------------------


@njit(**OPTIONS)
def _splat(u, v, r, half, across, out):
    """Draw one point of half width `half` rows, `across` columns at (u, v); the closest range stays."""
    H, W = out.shape
    top, bottom = math.ceil(v - half), math.floor(v + half)
    if bottom < top:
        top = bottom = math.floor(v + np.float32(0.5))
    left, right = math.ceil(u - across), math.floor(u + across)
    if right < left:
        left = right = math.floor(u + np.float32(0.5))
    for row in range(max(top, 0), min(bottom, H - 1) + 1):
        for column in range(left, right + 1):
            c = column + W if column < 0 else column - W if column >= W else column
            if not out[row, c] <= r:  # true for NaN, too
                out[row, c] = r


@njit(**OPTIONS)
def _draw(place, points, starts, sizes, edges, window, splat, out):
    """Draw what one place (3,) sees into out (H, W): of each copy of the points what lies between its edges."""
    out[:] = np.float32(np.nan)
    W = np.float32(out.shape[1])
    full_width, offset_v = window[0], window[1]
    by_angle = full_width / (PI + PI)
    for k in range(len(sizes)):
        near, far = edges[k] * edges[k], edges[k + 1] * edges[k + 1]
        half_spacing = np.float32(0.5) * splat * sizes[k] * by_angle
        for i in range(starts[k], starts[k + 1]):
            x, y, z = points[i, 0] - place[0], points[i, 1] - place[1], points[i, 2] - place[2]
            square = x * x + y * y + z * z
            if square < near or square >= far:
                continue
            r, horizontal = math.sqrt(square), math.sqrt(x * x + y * y)
            v = full_width * np.float32(0.25) - arctangent2(z, horizontal) * by_angle - np.float32(0.5) - offset_v
            half = min(half_spacing / r, np.float32(MAX_SPLAT))
            if v + half > -1 and v - half < out.shape[0]:
                u = full_width * np.float32(0.5) - arctangent2(y, x) * by_angle - np.float32(0.5)
                across = min(half * r / max(horizontal, MIN_RANGE), W / np.float32(2.1))
                _splat(u, v, r, half, across, out)


@njit(parallel=True, **OPTIONS)
def draw_many(places, points, starts, sizes, edges, window, splat, out):
    """Draw M places (M, 3) f4 into out (M, H, W) f4.

    points (P, 3) f4: K copies of the cloud, ever coarser, from starts (K + 1,) on; sizes (K,) f4: of their voxels;
    edges (K + 1,) f4: from which distance to which each is drawn. window: columns of the whole sphere, first row.
    """
    for i in prange(len(places)):
        _draw(places[i], points, starts, sizes, edges, window, np.float32(splat), out[i])
    return out


# ---- files ------------------------------------------------------------------------------------------------------


@njit(**OPTIONS)
def decompress_lzf(data, out):
    """Expand LZF data (N,) u1 into out (M,) u1; return the bytes written, -1 where the data make no sense."""
    source, target = 0, 0
    while source < len(data):
        control = int(data[source])
        source += 1
        if control < 32:  # literal run
            length = control + 1
            if source + length > len(data) or target + length > len(out):
                return -1
            out[target : target + length] = data[source : source + length]
            source += length
            target += length
            continue
        length = control >> 5
        if length == 7:
            if source >= len(data):
                return -1
            length += int(data[source])
            source += 1
        if source >= len(data):
            return -1
        start = target - ((control & 31) << 8) - int(data[source]) - 1
        source += 1
        length += 2
        if start < 0 or target + length > len(out):
            return -1
        for i in range(length):  # may overlap: one byte at a time
            out[target + i] = out[start + i]
        target += length
    return target
