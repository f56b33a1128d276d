"""Loops over the pixels of spheres. Plain arrays in, plain arrays out; the callers check shapes."""

from __future__ import annotations

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit
from sphere_nav.photometric.align.iteration.kernels import arctangent2

SCALE = 16.0  # levels are sixteenths of a grey level


@njit(**OPTIONS)
def warp_by_range(inverse_range, directions, row, column, lens, u, v):
    """Write camera pixels u, v (h, w) f32 of a part of a sphere whose inverse range (H, W) f32 is known everywhere.

    The part begins at (row, column). directions: sine and cosine of azimuths (2, W) and elevations
    (2, H). lens: R (3, 3), b (3,), so that p = R ray - b / range is the point in the frame of the camera, by its range;
    extent (2,) and table (S S, 2): pixels over p_x and p_y by |p| + p_z, the tangents of half the angle off the axis;
    extent: the largest one, entries by tangent. Beyond the table its border holds.
    """
    azimuths, elevations = directions
    R, b, extent, table = lens
    height, width = u.shape
    side = np.int32(np.sqrt(np.float32(len(table))) + np.float32(0.5))
    xx, xy, xz, yx, yy, yz, zx, zy, zz = R.ravel()
    bx, by, bz = b
    largest, per_tangent = extent
    zero, last, least = np.float32(0.0), np.float32(side - 2), np.float32(1e-3)
    at, fu, fv = np.empty(width, np.int32), np.empty(width, np.float32), np.empty(width, np.float32)
    sines, cosines = azimuths[0, column : column + width], azimuths[1, column : column + width]
    for y in range(height):
        z, level = elevations[0, row + y], elevations[1, row + y]
        w = inverse_range[row + y, column : column + width]
        for i in range(width):
            dx, dy = level * cosines[i], level * sines[i]
            px = xx * dx + xy * dy + xz * z - w[i] * bx
            py = yx * dx + yy * dy + yz * z - w[i] * by
            pz = zx * dx + zy * dy + zz * z - w[i] * bz
            share = np.float32(1.0) / max(np.sqrt(px * px + py * py + pz * pz) + pz, least)
            s = min(max((px * share + largest) * per_tangent, zero), last)
            t = min(max((py * share + largest) * per_tangent, zero), last)
            i0, j0 = np.int32(s), np.int32(t)
            at[i], fu[i], fv[i] = j0 * side + i0, s - np.float32(i0), t - np.float32(j0)
        for i in range(width):
            k = at[i]
            for c, out in ((0, u), (1, v)):
                top = table[k, c] + fu[i] * (table[k + 1, c] - table[k, c])
                low = table[k + side, c] + fu[i] * (table[k + side + 1, c] - table[k + side, c])
                out[y, i] = top + fv[i] * (low - top)


@njit(**OPTIONS)
def compare_images(top, bottom, disparity, terms):
    """Write what one step of alignment needs to terms (6, H, W) i32: 1, s, e, s^2, s e, e^2; 0 where unknown.

    top, bottom (H, W) u8; disparity (H, W) f32. e = bottom(v - d) - top(v), s = mean slope of both along the column,
    bottom interpolated by cubic convolution; both in sixteenths of a grey level, so that sums are exact.
    """
    height, width = top.shape
    scale, half, one, two, three = (
        np.float32(SCALE),
        np.float32(0.5),
        np.float32(1.0),
        np.float32(2.0),
        np.float32(3.0),
    )
    terms[:, 0], terms[:, height - 1] = 0, 0
    last, stride, lower = np.float32(height - 2), np.int32(width), bottom.ravel()
    for v in range(1, height - 1):
        row, above, middle, below, d = np.float32(v), top[v - 1], top[v], top[v + 1], disparity[v]
        n, s, e, ss, se, ee = terms[0, v], terms[1, v], terms[2, v], terms[3, v], terms[4, v], terms[5, v]
        for u in range(width):
            y = row - d[u]
            is_inside = (y >= one) & (y < last)  # not so where d is NaN
            y = y if is_inside else one
            y0 = np.int32(y)
            f = y - np.float32(y0)
            at = np.int64((y0 - np.int32(1)) * stride) + u  # no branch and one index: the arithmetic becomes vectors
            p0, p1 = np.float32(lower[at]), np.float32(lower[at + width])
            p2, p3 = np.float32(lower[at + 2 * width]), np.float32(lower[at + 3 * width])
            k1 = half * (p2 - p0)
            k2 = p0 - np.float32(2.5) * p1 + two * p2 - half * p3
            k3 = half * (p3 - p0) + np.float32(1.5) * (p1 - p2)
            value = p1 + f * (k1 + f * (k2 + f * k3))
            slope = k1 + f * (two * k2 + f * three * k3)
            across = half * (np.float32(below[u]) - np.float32(above[u]))
            n[u] = np.int32(1) if is_inside else np.int32(0)
            s[u] = np.int32(np.floor(half * (slope + across) * scale + half)) * n[u]
            e[u] = np.int32(np.floor((value - np.float32(middle[u])) * scale + half)) * n[u]
            ss[u], se[u], ee[u] = s[u] * s[u], s[u] * e[u], e[u] * e[u]


@njit(**OPTIONS)
def step_blocks(sums, limits, start, disparity, information, left):
    """Move disparity (N,) f32 to where its block beside a constant, and its match, make it most probable.

    sums (6, N) i32: of the terms over the block; limits: largest step in px, least pixels of a block, variance of a
    grey level, variance of a match in px^2; start: the match. information: 1 / variance of the result by the slopes and
    by what is left, not by the match; left: mean squared difference that is left, over what noise and contrast allow;
    all alike. No branches, so vectors.
    """
    limit, least, noise, prior = limits
    zero, one, half, per_level = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(1.0 / SCALE)
    per_square, per_prior = per_level * per_level, one / prior
    for u in range(disparity.size):
        n, d = np.float32(sums[0, u]), disparity[u]
        is_known = (n >= least) & (d == d)
        share = one / max(n, one)
        s, e = np.float32(sums[1, u]) * share * per_level, np.float32(sums[2, u]) * share * per_level
        ss = max(np.float32(sums[3, u]) * share * per_square - s * s, zero)
        se = np.float32(sums[4, u]) * share * per_square - s * e
        ee = np.float32(sums[5, u]) * share * per_square - e * e
        seen = ss * n * half / noise
        wanted = se / max(ss, np.float32(1e-3))
        step = (seen * wanted + (start[u] - d) * per_prior) / (seen + per_prior)
        residual = max(ee - wanted * se, zero) * half
        left[u] = residual / (noise + ss) if is_known else np.float32(np.inf)
        information[u] = ss * n * half / max(residual, noise) if is_known else zero
        disparity[u] = d + min(max(step, -limit), limit) if is_known else d


@njit(cache=True, nogil=True)
def _add_near(n, beside, middle, largest, total, number):
    """Add and count those of n values that differ from the middle one by at most `largest`; NaN is never near."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for u in range(n):
        is_near = abs(beside[u] - middle[u]) <= largest[u]
        total[u] += beside[u] if is_near else zero
        number[u] += one if is_near else zero


@njit(cache=True, nogil=True)
def _average_near(wide, radius, is_down, limit, share, out):
    """Write the mean of the pixels along the columns, or the rows, that differ little from the middle; see `smooth`."""
    height, width = wide.shape[0] - 2 * radius, wide.shape[1] - 2 * radius
    total, number, largest = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    zero = np.float32(0.0)
    for v in range(radius, radius + height):
        middle, mean = wide[v, radius : radius + width], out[v, radius : radius + width]
        for u in range(width):
            total[u], number[u] = zero, zero
            largest[u] = limit + share * abs(middle[u])
        for k in range(2 * radius + 1):
            row, first = (v + k - radius, radius) if is_down else (v, k)
            _add_near(width, wide[row, first : first + width], middle, largest, total, number)
        for u in range(width):
            mean[u] = total[u] / number[u] if number[u] > zero else np.nan


@njit(cache=True, nogil=True)
def smooth(disparity, radius, limit, share):
    """Return the mean over 2 radius + 1 rows, then as many columns, of what differs little from the middle.

    disparity (H, W) f32; limit px and share of the disparity: what is little. NaN stays NaN. A block's step says
    nothing of what changes within the block: without this, such errors would stay and grow.
    """
    height, width = disparity.shape
    wide = np.full((height + 2 * radius, width + 2 * radius), np.float32(np.nan))
    wide[radius : radius + height, radius : radius + width] = disparity
    between = wide.copy()
    _average_near(wide, radius, True, limit, share, between)
    _average_near(between, radius, False, limit, share, wide)
    return wide[radius : radius + height, radius : radius + width].copy()


@njit(**OPTIONS)
def _cross(a, b):
    """Return the cross product of two vectors of a plane, which are complex numbers."""
    return a.real * b.imag - a.imag * b.real


@njit(**OPTIONS)
def triangulate(disparity, std, axes, shown, baseline, per_m, limits, range_m, range_std_m):
    """Write the range from the centre of the upper sphere, and its standard deviation, (H, W) f32 m.

    disparity, std (H, W) f32 px. axes: sine and cosine of azimuths (2, W) and elevations (2, H). shown: of the upper
    and of the lower sphere, which camera shows a pixel (H, W) i1, and where the cameras stand (N, 3) f32 beside the
    centre, which is `baseline` lower for the lower one. per_m: 1 over the distance at which images were joined to
    spheres, so that a camera at o shows in pixel p what is along p - o per_m. limits: largest relative std, nearest
    range, far. Rays meet in the plane of pixel and axis, whose vectors are complex numbers: ahead + i up. +Inf where
    they surely do so beyond `far`, NaN where it is not known well enough.
    """
    max_relative, nearest, far = limits
    azimuths, elevations = axes
    (upper, upper_centers), (lower, lower_centers) = shown
    height, width = disparity.shape
    per_row = np.pi / height
    for v in range(height):
        direction = complex(elevations[1, v], elevations[0, v])
        for u in range(width):
            range_m[v, u] = np.nan
            range_std_m[v, u] = np.nan
            sigma = std[v, u] * per_row
            if not (sigma < 1e3):
                continue
            slope, sine, cosine = tangent(disparity[v, u] * per_row), azimuths[0, u], azimuths[1, u]
            turned = direction * complex(1.0, slope)
            turned /= abs(turned)
            a, b = upper_centers[upper[v, u]], lower_centers[lower[v, u]]
            eye = complex(a[0] * cosine + a[1] * sine, a[2])
            low_eye = complex(b[0] * cosine + b[1] * sine, b[2] - baseline)
            ray, low_ray = direction - eye * per_m, turned - (low_eye + complex(0.0, baseline)) * per_m
            parallax, across = _cross(ray, low_ray), _cross(low_eye - eye, low_ray)
            if (parallax + 2 * sigma) * far < across:
                range_m[v, u] = np.inf
                continue
            r = abs(eye + ray * (across / parallax))
            relative = abs(1.0 / slope + turned.imag / turned.real) * sigma  # (cot(d) + cot(b)) sigma
            if parallax > 0.0 and turned.real > 0.0 and r >= nearest and relative <= max_relative:
                range_m[v, u] = r
                range_std_m[v, u] = relative * r


@njit(**OPTIONS)
def tangent(angle):
    """Return tan(angle); its series (relative error 1e-7) up to 0.35 rad."""
    if angle > 0.35:
        return np.tan(angle)
    q = angle * angle
    return angle * (1.0 + q * (1 / 3 + q * (2 / 15 + q * (17 / 315 + q * (62 / 2835 + q * (1382 / 155925))))))


@njit(**OPTIONS)
def recenter(range_m, std_m, owner, centers, columns, rows, per_m, new_range, new_std):
    """Write the ranges (H, W) f32 from the sphere's centre in the directions of the pixels, not of what these show.

    owner (H, W) i1: which camera shows a pixel, -1 none; centers (N, 3) f32: where it stands; columns (2, W), rows
    (2, H): sine and cosine of the azimuth of each column and of the elevation of each row; per_m: 1 over the distance
    for which the images were joined, where a point is seen in its own pixel. A pixel takes the range of the pixel in
    which its point is seen.
    """
    height, width = range_m.shape
    one, half = np.float32(1.0), np.float32(0.5)  # and no number of twice the precision: this runs over two million
    per_column, per_row = np.float32(0.5 * width / np.pi), np.float32(height / np.pi)
    for v in range(height):
        z, level = rows[0, v], rows[1, v]
        for u in range(width):
            new_range[v, u] = np.nan
            new_std[v, u] = np.nan
            camera, reach = owner[v, u], range_m[v, u]
            if camera < 0 or not np.isfinite(reach):
                new_range[v, u] = reach
                continue
            x, y = level * columns[1, u], level * columns[0, u]
            ox, oy, oz = centers[camera, 0], centers[camera, 1], centers[camera, 2]
            off = one - reach * per_m
            qx, qy, qz = reach * x - off * ox, reach * y - off * oy, reach * z - off * oz
            across = np.sqrt(qx * qx + qy * qy)
            du = -arctangent2(x * qy - y * qx, x * qx + y * qy) * per_column
            dv = -arctangent2(level * qz - z * across, level * across + z * qz) * per_row
            column = int(np.floor(np.float32(u) + du + half)) % width
            row = min(max(int(np.floor(np.float32(v) + dv + half)), 0), height - 1)
            if np.isfinite(range_m[row, column]):
                new_range[v, u] = range_m[row, column]
                new_std[v, u] = std_m[row, column]
