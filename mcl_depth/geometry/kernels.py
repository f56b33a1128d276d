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
BLOCK = 256  # points projected at once
MAX_STACK = 4096
MAX_SPLAT = 12.0  # px, half width of the largest drawn point
PI = np.float32(math.pi)


# ---- drawing ----------------------------------------------------------------------------------------------------


@njit(**OPTIONS)
def _is_outside(box, px, py, pz, limits, max_range):
    """Return whether a box (6,) is out of range or above or below the picture, and its distance in m."""
    dx = max(box[0] - px, px - box[3], 0.0)
    dy = max(box[1] - py, py - box[4], 0.0)
    dz = max(box[2] - pz, pz - box[5], 0.0)
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    if distance > max_range:
        return True, distance
    nearest = math.sqrt(dx * dx + dy * dy)
    fx = max(abs(box[0] - px), abs(box[3] - px))
    fy = max(abs(box[1] - py), abs(box[4] - py))
    farthest = math.sqrt(fx * fx + fy * fy)
    highest, lowest = box[5] - pz, box[2] - pz
    is_below = highest < limits[0] * (farthest if limits[0] < 0 else nearest) - 1.0
    is_above = lowest > limits[1] * (farthest if limits[1] > 0 else nearest) + 1.0
    return is_below or is_above, distance


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
def _draw_points(points, first, end, voxel, position, window, splat, reach, scratch, out):
    """Project points first:end and draw them; scratch (5, BLOCK)."""
    W = np.float32(out.shape[1])
    full_width, offset_v = window[0], window[1]
    by_angle = full_width / (PI + PI)
    px, py, pz = np.float32(position[0]), np.float32(position[1]), np.float32(position[2])
    u, v, r, half, across = scratch
    half_spacing = np.float32(0.5) * splat * voxel * by_angle
    for start in range(first, end, BLOCK):
        n = min(BLOCK, end - start)
        for i in range(n):
            x, y, z = points[start + i, 0] - px, points[start + i, 1] - py, points[start + i, 2] - pz
            horizontal = math.sqrt(x * x + y * y)
            r[i] = math.sqrt(x * x + y * y + z * z)
            u[i] = full_width * np.float32(0.5) - arctangent2(y, x) * by_angle - np.float32(0.5)
            v[i] = full_width * np.float32(0.25) - arctangent2(z, horizontal) * by_angle
            v[i] -= np.float32(0.5) + offset_v
            half[i] = min(half_spacing / max(r[i], MIN_RANGE), np.float32(MAX_SPLAT))
            across[i] = min(half[i] * r[i] / max(horizontal, MIN_RANGE), W / np.float32(2.1))
        for i in range(n):
            if reach[0] <= r[i] <= reach[1] and v[i] + half[i] > -1 and v[i] - half[i] < out.shape[0]:
                _splat(u[i], v[i], r[i], half[i], across[i], out)


@njit(**OPTIONS)
def _draw(position, points, tiles, boxes, voxels, num_roots, window, limits, coarseness, splat, reach, out):
    """Draw the tiles that one place (3,) sees into out (H, W), each from the copy that suits its distance."""
    out[:] = np.float32(np.nan)
    scratch = np.empty((5, BLOCK), np.float32)
    stack = np.empty(MAX_STACK, np.int64)
    pixel = coarseness * 2.0 * math.pi / window[0]
    px, py, pz = position[0], position[1], position[2]
    height = 0
    for root in range(num_roots):
        stack[height] = root
        height += 1
    while height > 0:
        height -= 1
        tile = stack[height]
        outside, distance = _is_outside(boxes[tile], px, py, pz, limits, reach[1])
        if outside:
            continue
        first, end, child, end_child = tiles[tile, 0], tiles[tile, 1], tiles[tile, 2], tiles[tile, 3]
        if child == end_child or voxels[tile] <= pixel * distance or height + end_child - child > MAX_STACK:
            _draw_points(points, first, end, voxels[tile], position, window, splat, reach, scratch, out)
        else:
            for other in range(child, end_child):
                stack[height] = other
                height += 1


@njit(parallel=True, **OPTIONS)
def draw_many(
    positions, points, tiles, boxes, voxels, num_roots, window, limits, coarseness, splat, min_range, max_range, out
):
    """Draw M places: positions (M, 3) f8, points (P, 3) f4, tiles (T, 4) i8, boxes (T, 6) f4, out (M, H, W) f4.

    tiles: first and end point, first and end child. window: columns of the whole sphere, first row of the picture.
    limits: tangents of the lowest and highest elevation.
    """
    reach = np.array([min_range, max_range], np.float32)
    for i in prange(len(positions)):
        _draw(
            positions[i], points, tiles, boxes, voxels, num_roots,
            window, limits, coarseness, np.float32(splat), reach, out[i],
        )  # fmt: skip
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
