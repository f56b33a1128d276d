"""Loops over the pixels of spheres. Plain arrays in, plain arrays out; the callers check shapes."""

from __future__ import annotations

import numpy as np
from numba import njit

SCALE = 16.0  # pyramids are int16 with four bits below the point


@njit(cache=True, nogil=True)
def add_band(fine, coarse, weight, row, column, total):
    """Add weight (h, w) f32 x (fine - coarse) (h, w, c) u8 to total (H, W, c) i16 at row, column; columns wrap."""
    height, width, channels = fine.shape
    whole = total.shape[1]
    for y in range(height):
        for x in range(width):
            share = weight[y, x] * SCALE
            if share == 0.0:
                continue
            at = (column + x) % whole
            for c in range(channels):
                value = share * (np.float32(fine[y, x, c]) - np.float32(coarse[y, x, c]))
                total[row + y, at, c] += np.int16(np.floor(value + 0.5))


@njit(cache=True, nogil=True)
def to_levels(total, is_covered, image):
    """Write total (H, W, c) i16 as grey levels 1...255 to image (H, W, c) u8; 0 where not covered."""
    height, width, channels = total.shape
    for y in range(height):
        for x in range(width):
            for c in range(channels):
                value = np.floor(total[y, x, c] / SCALE + 0.5)
                image[y, x, c] = np.uint8(min(max(value, 1.0), 255.0)) if is_covered[y, x] else np.uint8(0)


@njit(cache=True, nogil=True)
def warp_by_range(grid_u, grid_v, inverse_levels, step, inverse_range, row, column, u, v):
    """Write camera pixels u, v (h, w) f32 of a block of a sphere whose inverse range (H, W) f32 is known everywhere.

    grid_u, grid_v (K, gh, gw) f32: pixels at every step-th row and column of the block, at each of K inverse ranges.
    Linear in all three.
    """
    height, width = u.shape
    whole = inverse_range.shape[1]
    last = inverse_levels.size - 2
    for y in range(height):
        gy = y // step
        fy = np.float32(y - gy * step) / np.float32(step)
        for x in range(width):
            gx = x // step
            fx = np.float32(x - gx * step) / np.float32(step)
            w = inverse_range[row + y, (column + x) % whole]
            k = 0
            while k < last and w > inverse_levels[k + 1]:
                k += 1
            fw = min((w - inverse_levels[k]) / (inverse_levels[k + 1] - inverse_levels[k]), np.float32(1.0))
            a, b, c, d = (1 - fy) * (1 - fx), (1 - fy) * fx, fy * (1 - fx), fy * fx
            u0 = (
                a * grid_u[k, gy, gx]
                + b * grid_u[k, gy, gx + 1]
                + c * grid_u[k, gy + 1, gx]
                + d * grid_u[k, gy + 1, gx + 1]
            )
            v0 = (
                a * grid_v[k, gy, gx]
                + b * grid_v[k, gy, gx + 1]
                + c * grid_v[k, gy + 1, gx]
                + d * grid_v[k, gy + 1, gx + 1]
            )
            j = k + 1
            u1 = (
                a * grid_u[j, gy, gx]
                + b * grid_u[j, gy, gx + 1]
                + c * grid_u[j, gy + 1, gx]
                + d * grid_u[j, gy + 1, gx + 1]
            )
            v1 = (
                a * grid_v[j, gy, gx]
                + b * grid_v[j, gy, gx + 1]
                + c * grid_v[j, gy + 1, gx]
                + d * grid_v[j, gy + 1, gx + 1]
            )
            u[y, x] = u0 + fw * (u1 - u0)
            v[y, x] = v0 + fw * (v1 - v0)


@njit(cache=True, nogil=True)
def compare_along_columns(top, bottom, disparity, terms):
    """Write what one step of alignment needs to terms (H, W, 6) f32: 1, s, e, s^2, s e, of each known pixel; 0 else.

    e = bottom(v - d) - top(v) in grey levels, s = mean slope of both along the column, d the disparity (H, W) f32.
    The last term is e^2.
    """
    height, width = top.shape
    for v in range(height):
        for u in range(width):
            d = disparity[v, u]
            y = v - d
            for k in range(6):
                terms[v, u, k] = 0.0
            if not (y >= 1.0 and y < height - 2.0 and v >= 1 and v < height - 1):
                continue
            y0 = int(np.floor(y))
            f = np.float32(y - y0)
            a, b = bottom[y0 - 1, u], bottom[y0, u]
            c, e = bottom[y0 + 1, u], bottom[y0 + 2, u]
            k1, k2, k3 = (
                np.float32(0.5) * (c - a),
                a - np.float32(2.5) * b + np.float32(2.0) * c - np.float32(0.5) * e,
                np.float32(0.5) * (e - a) + np.float32(1.5) * (b - c),
            )
            value = b + f * (k1 + f * (k2 + f * k3))
            slope = k1 + f * (np.float32(2.0) * k2 + f * np.float32(3.0) * k3)
            s = np.float32(0.25) * (top[v + 1, u] - top[v - 1, u]) + np.float32(0.5) * slope
            error = value - top[v, u]
            terms[v, u, 0] = 1.0
            terms[v, u, 1] = s
            terms[v, u, 2] = error
            terms[v, u, 3] = s * s
            terms[v, u, 4] = s * error
            terms[v, u, 5] = error * error


@njit(cache=True, nogil=True)
def step_disparity(means, limits, start, disparity, information, left):
    """Move disparity (H, W) f32 to where its block beside a constant, and its match, make it most probable.

    means (H, W, 6) f32: block means of the terms; limits: largest step in px, pixels of a block, variance of a grey
    level, variance of a match in px^2; start (H, W) f32: the match. information (H, W) f32: 1 / variance of the result;
    left (H, W) f32: mean squared difference that is left, minus what is allowed to a block of its contrast, if above 0.
    """
    limit, area, noise, prior = limits
    height, width = disparity.shape
    for v in range(height):
        for u in range(width):
            share = means[v, u, 0]
            if share < 0.2 or np.isnan(disparity[v, u]):
                information[v, u] = 0.0
                left[v, u] = np.inf
                continue
            s, e = means[v, u, 1] / share, means[v, u, 2] / share
            ss = means[v, u, 3] / share - s * s
            se = means[v, u, 4] / share - s * e
            ee = means[v, u, 5] / share - e * e
            seen = max(ss, np.float32(0.0)) * share * area / (2 * noise)
            wanted = se / max(ss, np.float32(1e-3))
            information[v, u] = seen + 1 / prior
            step = (seen * wanted + (start[v, u] - disparity[v, u]) / prior) / information[v, u]
            left[v, u] = max(ee - wanted * se, np.float32(0.0)) / (2 * noise + 2 * max(ss, np.float32(0.0)))
            disparity[v, u] += min(max(step, -limit), limit)


@njit(cache=True, nogil=True)
def triangulate(disparity, std, per_row, first_row, baseline, limits, range_m, range_std_m):
    """Write range along the ray from the upper centre, and its standard deviation, (H, W) f32 m.

    disparity, std (H, W) f32 px; per_row: radians of a row; limits: largest relative std, nearest range, far. A point
    at colatitude a from above and b = a - disparity from below is at baseline sin(b) / sin(a - b). +Inf where it is
    surely beyond `far`, NaN where it is not known well enough.
    """
    max_relative, nearest, far = limits
    height, width = disparity.shape
    for v in range(height):
        above = (v + first_row + 0.5) * per_row
        sine, cosine = np.sin(above), np.cos(above)
        least = baseline * sine / far
        for u in range(width):
            range_m[v, u] = np.nan
            range_std_m[v, u] = np.nan
            delta, sigma = disparity[v, u] * per_row, std[v, u] * per_row
            if not (sigma < 1e3):
                continue
            if delta + 2 * sigma < least:
                range_m[v, u] = np.inf
                continue
            if delta <= 0.0 or above <= delta:
                continue
            s, c = np.sin(delta), np.cos(delta)
            sine_below, cosine_below = sine * c - cosine * s, cosine * c + sine * s
            r = baseline * sine_below / s
            relative = abs(cosine_below / sine_below + c / s) * sigma
            if r >= nearest and relative <= max_relative:
                range_m[v, u] = r
                range_std_m[v, u] = relative * r


@njit(cache=True, nogil=True)
def splat_with_std(u, v, range_m, std_m, half, wraps, nearest, nearest_std):
    """Write ranges (N,) f32 and their std to the pixels around (u, v) of nearest (H, W) f32, keeping the nearest.

    nearest starts as +Inf, nearest_std as NaN. Without `half` the four pixels around, else (2 half + 1)^2.
    """
    height, width = nearest.shape
    for i in range(u.size):
        if np.isnan(u[i]) or np.isnan(v[i]) or np.isnan(range_m[i]):
            continue
        if half > 0:
            x0, y0, size = int(np.floor(u[i] + 0.5)) - half, int(np.floor(v[i] + 0.5)) - half, 2 * half + 1
        else:
            x0, y0, size = int(np.floor(u[i])), int(np.floor(v[i])), 2
        for y in range(max(y0, 0), min(y0 + size, height)):
            for dx in range(size):
                x = x0 + dx
                if wraps:
                    x = x % width
                if x >= 0 and x < width and range_m[i] < nearest[y, x]:
                    nearest[y, x] = range_m[i]
                    nearest_std[y, x] = std_m[i]


@njit(cache=True, nogil=True)
def small_angle(sine, cosine):
    """Return the angle whose sine and cosine are in this proportion; a series where it is small."""
    if cosine <= 0.0 or abs(sine) > 0.2 * cosine:
        return np.arctan2(sine, cosine)
    t = sine / cosine
    return t * (1.0 - t * t * (1.0 / 3.0 - 0.2 * t * t))


@njit(cache=True, nogil=True)
def recentre(range_m, std_m, owner, offsets, columns, rows, new_range, new_std):
    """Move ranges (H, W) f32 seen from the cameras' own centres to the centre of the sphere.

    owner (H, W) i1: which camera shows a pixel, -1 none; offsets (N, 3) f32: its centre in the sphere's frame; columns
    (2, W), rows (2, H): sine and cosine of the azimuth of each column and of the elevation of each row. A pixel takes
    the range of the pixel in which its point is seen.
    """
    height, width = range_m.shape
    for v in range(height):
        z, level = rows[0, v], rows[1, v]
        for u in range(width):
            new_range[v, u] = np.nan
            new_std[v, u] = np.nan
            camera = owner[v, u]
            if camera < 0:
                continue
            r = range_m[v, u]
            if np.isnan(r) or np.isinf(r):
                new_range[v, u] = r
                new_std[v, u] = std_m[v, u]
                continue
            x, y = level * columns[1, u], level * columns[0, u]
            ox, oy, oz = offsets[camera, 0], offsets[camera, 1], offsets[camera, 2]
            along = ox * x + oy * y + oz * z
            reach = r + along  # of the point from the centre
            qx, qy, qz = reach * x - ox, reach * y - oy, reach * z - oz
            across = np.sqrt(qx * qx + qy * qy)
            du = -small_angle(x * qy - y * qx, x * qx + y * qy) / (2 * np.pi) * width
            dv = -small_angle(level * qz - z * across, level * across + z * qz) / np.pi * height
            column = int(np.floor(u + du + 0.5)) % width
            row = min(max(int(np.floor(v + dv + 0.5)), 0), height - 1)
            seen = range_m[row, column]
            if np.isfinite(seen):
                new_range[v, u] = seen + along
                new_std[v, u] = std_m[row, column]


def warm_up() -> None:
    """Compile on tiny arrays, so that the first image does not wait."""
    byte, plane = np.zeros((4, 4, 1), np.uint8), np.ones((4, 4), np.float32)
    total = np.zeros((4, 4, 1), np.int16)
    add_band(byte, byte, plane, 0, 0, total)
    colour, colour_total = np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4, 3), np.int16)
    add_band(colour, colour, plane, 0, 0, colour_total)
    for sums, image in ((total, byte), (colour_total, colour)):
        to_levels(sums, np.ones((4, 4), np.bool_), image)
    grid, out = np.zeros((2, 3, 3), np.float32), np.empty((4, 4), np.float32)
    levels = np.array([0.0, 1.0], np.float32)
    warp_by_range(grid, grid, levels, 2, plane, 0, 0, out, out.copy())
    terms = np.empty((4, 4, 6), np.float32)
    compare_along_columns(plane, plane, plane, terms)
    step_disparity(terms, np.ones(4, np.float32), plane, plane.copy(), out, out.copy())
    triangulate(plane, plane, 0.1, 0.0, 0.3, (0.1, 0.1, 100.0), out, out.copy())
    line = np.zeros(1, np.float32)
    splat_with_std(line, line, line, line, 0, True, plane.copy(), plane.copy())
    unit, owner = np.zeros((2, 4), np.float32), np.zeros((4, 4), np.int8)
    recentre(plane, plane, owner, np.zeros((1, 3), np.float32), unit, unit, out, out.copy())
