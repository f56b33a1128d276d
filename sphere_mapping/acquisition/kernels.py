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
    last, stride, lower, between = np.float32(height - 2), np.int32(width), bottom.ravel(), np.empty(width, np.float32)
    levels = np.empty((4, width), np.float32)
    for v in range(1, height - 1):
        row, above, middle, below, d = np.float32(v), top[v - 1], top[v], top[v + 1], disparity[v]
        n, s, e, ss, se, ee = terms[0, v], terms[1, v], terms[2, v], terms[3, v], terms[4, v], terms[5, v]
        for u in range(width):  # reading by itself: the arithmetic below, with few arrays, becomes vectors
            y = row - d[u]
            is_inside = (y >= one) & (y < last)  # not so where d is NaN
            y = y if is_inside else one
            y0 = np.int32(y)
            at = np.int64((y0 - np.int32(1)) * stride) + u
            levels[0, u], levels[1, u] = np.float32(lower[at]), np.float32(lower[at + width])
            levels[2, u], levels[3, u] = np.float32(lower[at + 2 * width]), np.float32(lower[at + 3 * width])
            between[u], n[u] = y - np.float32(y0), np.int32(1) if is_inside else np.int32(0)
        for u in range(width):
            f, p0, p1, p2, p3 = between[u], levels[0, u], levels[1, u], levels[2, u], levels[3, u]
            k1 = half * (p2 - p0)
            k2 = p0 - np.float32(2.5) * p1 + two * p2 - half * p3
            k3 = half * (p3 - p0) + np.float32(1.5) * (p1 - p2)
            value = p1 + f * (k1 + f * (k2 + f * k3))
            slope = k1 + f * (two * k2 + f * three * k3)
            across = half * (np.float32(below[u]) - np.float32(above[u]))
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


@njit(**OPTIONS)
def judge_blocks(start, refined, information, left, slopes, limits, value, std):
    """Write the disparity (H, W) f32 of aligned blocks and its deviation; NaN where a block is not trusted.

    information, left: of `step_blocks`. slopes (2, H, W): mean squared ones across and along the columns: calibration
    leaves as much across as along, which becomes disparity on a line nearly along the column. limits: way from the
    match in px, what may be left, variance by that of independent errors, variance that calibration leaves in px^2.
    """
    farthest, most, factor, calibration = limits
    one, nothing = np.float32(1.0), np.float32(np.nan)
    for v in range(value.shape[0]):
        for u in range(value.shape[1]):
            is_good = (abs(refined[v, u] - start[v, u]) <= farthest) & (left[v, u] <= most) & (information[v, u] > 0)
            left_over = calibration * (one + slopes[0, v, u] / max(slopes[1, v, u], one))
            value[v, u] = refined[v, u] if is_good else nothing
            std[v, u] = np.sqrt(factor / information[v, u] + left_over) if is_good else nothing


@njit(**OPTIONS)
def add_band(finer, coarser, weight, total):
    """Add what levels (h, w c) u8 are above coarser ones, by weight (h, w), to total (h, w c) i16, in sixteenths."""
    half, sixteen = np.float32(0.5), np.float32(16.0)
    (height, width), size = weight.shape, total.shape[1]
    channels, share = size // width, np.empty(size, np.float32)
    for v in range(height):
        for u in range(width):
            share[u * channels : (u + 1) * channels] = sixteen * weight[v, u]
        for i in range(size):
            band = np.float32(finer[v, i]) - np.float32(coarser[v, i])
            total[v, i] += np.int16(np.int32(np.floor(share[i] * band + half)))


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
def _place_in_plane(owner, centers, azimuths, along, up):
    """Write where the cameras that show a row's pixels (W,) stand in the plane of pixel and axis."""
    for u in range(owner.size):
        center = centers[owner[u]]
        along[u], up[u] = center[0] * azimuths[1, u] + center[1] * azimuths[0, u], center[2]


@njit(**OPTIONS)
def triangulate(disparity, std, axes, shown, baseline, per_m, limits, range_m, range_std_m):
    """Write the range from the centre of the upper sphere, and its standard deviation, (H, W) f32 m.

    disparity, std (H, W) px. axes: sine and cosine of azimuths (2, W) and elevations (2, H). shown: of the upper
    and of the lower sphere, which camera shows a pixel (H, W) i1, and where the cameras stand (N, 3) beside the
    centre, which is `baseline` lower for the lower one. per_m: 1 over the distance at which images were joined to
    spheres, so that a camera at o shows in pixel p what is along p - o per_m. limits: largest relative std, nearest
    range, far. All in f32: rays meet in the plane of pixel and axis. +Inf where they surely do so beyond `far`, NaN
    where it is not known well enough. The loop over a row has no branch: it becomes vectors.
    """
    max_relative, nearest, far = limits
    azimuths, elevations = axes
    (upper, upper_centers), (lower, lower_centers) = shown
    height, width = disparity.shape
    a, a_up, b, b_up = np.empty((4, width), np.float32)
    per_row, zero, two = np.float32(np.pi / height), np.float32(0.0), np.float32(2.0)
    nothing, beyond = np.float32(np.nan), np.float32(np.inf)
    for v in range(height):
        z, level = elevations[0, v], elevations[1, v]
        _place_in_plane(upper[v], upper_centers, azimuths, a, a_up)
        _place_in_plane(lower[v], lower_centers, azimuths, b, b_up)
        for u in range(width):
            sigma = std[v, u] * per_row
            sine, cosine = rotation(disparity[v, u] * per_row)
            low_level, low_z = level * cosine - z * sine, z * cosine + level * sine
            ray, ray_up, low_ray = level - a[u] * per_m, z - a_up[u] * per_m, low_level - b[u] * per_m
            low_ray_up, apart, apart_up = low_z - b_up[u] * per_m, b[u] - a[u], b_up[u] - baseline - a_up[u]
            parallax, across = ray * low_ray_up - ray_up * low_ray, apart * low_ray_up - apart_up * low_ray
            is_far = (parallax + two * sigma) * far < across
            reach = across / parallax
            x, y = a[u] + ray * reach, a_up[u] + ray_up * reach
            r = np.sqrt(x * x + y * y)
            relative = abs(cosine / sine + low_z / low_level) * sigma  # (cot(d) + cot(b)) sigma
            is_known = (parallax > zero) & (low_level > zero) & (r >= nearest) & (relative <= max_relative) & ~is_far
            range_m[v, u] = beyond if is_far else (r if is_known else nothing)
            range_std_m[v, u] = relative * r if is_known else nothing


@njit(**OPTIONS)
def rotation(angle):
    """Return sine and cosine of an angle up to 1.2 rad by their series (error 1e-7), which vectorise."""
    q, one, a, b = angle * angle, np.float32(1.0), np.float32(1 / 6), np.float32(1 / 24)
    c, d, e, f = np.float32(1 / 120), np.float32(1 / 720), np.float32(1 / 5040), np.float32(1 / 40320)
    g, h = np.float32(1 / 362880), np.float32(1 / 3628800)
    cosine = one - q * (np.float32(0.5) - q * (b - q * (d - q * (f - q * h))))
    return angle * (one - q * (a - q * (c - q * (e - q * g)))), cosine


@njit(**OPTIONS)
def recenter(range_m, std_m, owner, centers, columns, rows, per_m, new_range, new_std):
    """Write the ranges (H, W) f32 from the sphere's centre in the directions of the pixels, not of what these show.

    owner (H, W) i1: which camera shows a pixel, -1 none; centers (N, 3) f32: where it stands; columns (2, W), rows
    (2, H): sine and cosine of the azimuth of each column and of the elevation of each row; per_m: 1 over the distance
    for which the images were joined, where a point is seen in its own pixel. A pixel takes the range of the pixel in
    which its point is seen.
    """
    height, width = range_m.shape
    zero, one, half, nothing = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(np.nan)
    per_column, per_row = np.float32(0.5 * width / np.pi), np.float32(height / np.pi)
    ox, oy, oz = np.empty((3, width), np.float32)
    at, ranges, stds = np.empty(width, np.int32), range_m.ravel(), std_m.ravel()
    for v in range(height):
        z, level = rows[0, v], rows[1, v]
        for u in range(width):
            center = centers[owner[v, u]]
            ox[u], oy[u], oz[u] = center[0], center[1], center[2]
        for u in range(width):  # without a branch: it becomes vectors
            x, y = level * columns[1, u], level * columns[0, u]
            is_shown = (owner[v, u] >= 0) & (range_m[v, u] < np.float32(np.inf))
            reach = range_m[v, u] if is_shown else zero
            off = one - reach * per_m
            qx, qy, qz = reach * x - off * ox[u], reach * y - off * oy[u], reach * z - off * oz[u]
            across = np.sqrt(qx * qx + qy * qy)
            du = -arctangent2(x * qy - y * qx, x * qx + y * qy) * per_column
            dv = -arctangent2(level * qz - z * across, level * across + z * qz) * per_row
            column, row = np.int32(np.floor(np.float32(u) + du + half)), np.int32(np.floor(np.float32(v) + dv + half))
            column += np.int32(width if column < 0 else (-width if column >= width else 0))
            row = min(max(row, np.int32(0)), np.int32(height - 1))
            at[u] = row * np.int32(width) + column if is_shown else np.int32(-1)
        for u in range(width):
            seen = ranges[at[u]] if at[u] >= 0 else nothing
            is_known = seen < np.float32(np.inf)
            new_std[v, u] = stds[at[u]] if is_known else nothing
            new_range[v, u] = seen if is_known else (nothing if at[u] >= 0 else range_m[v, u])
