"""The inner loops of likeness: LCN, gradients, eq. 2. Plain arrays in and out.

Panoramas are (H, W) float32 whose columns wrap around; nothing here may show a seam.
"""

import math
import os

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit, prange
from sphere_nav.photometric.align.iteration.kernels import arctangent2

# Threads that spin while they wait stall every other process of a small vehicle computer; read when a kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


NO_DIRECTION = 255  # code of a pixel without a gradient
NUM_DIRECTIONS = 255  # codes of the half circle
MIN_GRADIENT = np.float32(1e-4)  # Sobel sums below this are rounding noise
MIN_RANGE = np.float32(1e-3)
PI = np.float32(math.pi)

_angles = (np.arange(256) * (math.pi / NUM_DIRECTIONS)).astype(np.float32)
COSINES = np.where(np.arange(256) == NO_DIRECTION, 0, np.cos(_angles)).astype(np.float32)
SINES = np.where(np.arange(256) == NO_DIRECTION, 0, np.sin(_angles)).astype(np.float32)
SQUARES = ((np.arange(256) / 255.0) ** 2).astype(np.float32)


# ---- NaN interpolation and LCN (algorithm 1) --------------------------------------------------------------------


@njit(**OPTIONS)
def _integrate(image, J):
    """Write the integral image of image (H, W) to J (H + 1, W + 1) f8."""
    H, W = image.shape
    J[0, :] = 0.0
    for y in range(H):
        total = 0.0
        J[y + 1, 0] = 0.0
        for x in range(W):
            total += image[y, x]
            J[y + 1, x + 1] = J[y, x + 1] + total


@njit(**OPTIONS)
def _box_sum(J, top, bottom, left, right):
    """Return the sum over rows top:bottom and columns left:right, which may reach around the seam."""
    W = J.shape[1] - 1
    if right - left >= W:
        return J[bottom, W] - J[top, W]
    total = 0.0
    if left < 0:
        total = J[bottom, W] - J[top, W] - J[bottom, W + left] + J[top, W + left]
        left = 0
    elif right > W:
        total = J[bottom, right - W] - J[top, right - W]
        right = W
    return total + J[bottom, right] - J[top, right] - J[bottom, left] + J[top, left]


@njit(**OPTIONS)
def fill_nan(image):
    """Replace NaN in image (H, W) by the mean of the smallest box around the pixel, of radius 2^n, that knows any."""
    H, W = image.shape
    known = np.empty((H, W), np.float32)
    num_known = 0
    for y in range(H):
        for x in range(W):
            is_known = not math.isnan(image[y, x])
            known[y, x] = np.float32(1.0) if is_known else np.float32(0.0)
            num_known += is_known
    if num_known in (0, H * W):
        if num_known == 0:
            image[:] = np.float32(0.0)
        return
    values = np.where(known > 0, image, np.float32(0.0))
    J, K = np.empty((H + 1, W + 1)), np.empty((H + 1, W + 1))
    _integrate(values, J)
    _integrate(known, K)
    for y in range(H):
        radius = 1
        for x in range(W):
            # nothing is known within half the radius that the unknown pixel before needed
            radius = max(radius >> 2, 1) if math.isnan(image[y, x]) else 1
            while math.isnan(image[y, x]):
                top, bottom = max(y - radius, 0), min(y + radius + 1, H)
                n = _box_sum(K, top, bottom, x - radius, x + radius + 1)
                if n > 0.5:
                    image[y, x] = _box_sum(J, top, bottom, x - radius, x + radius + 1) / n
                radius *= 2


@njit(**OPTIONS)
def normalize_contrast(image, k, min_sigma):
    """Return (D - m) / sigma of every pixel's (2k + 1)^2 neighbourhood (eq. 1); image (H, W) without NaN."""
    H, W = image.shape
    J, J2 = np.empty((H + 1, W + 1)), np.empty((H + 1, W + 1))
    _integrate(image, J)
    _integrate(image * image, J2)
    out = np.empty((H, W), np.float32)
    columns = min(2 * k + 1, W)
    for y in range(H):
        top, bottom = max(y - k, 0), min(y + k + 1, H)
        by_n = 1.0 / ((bottom - top) * columns)
        for x in range(W):
            if k <= x < W - k:
                left, right = x - k, x + k + 1
                total = J[bottom, right] - J[top, right] - J[bottom, left] + J[top, left]
                squares = J2[bottom, right] - J2[top, right] - J2[bottom, left] + J2[top, left]
            else:
                total = _box_sum(J, top, bottom, x - k, x + k + 1)
                squares = _box_sum(J2, top, bottom, x - k, x + k + 1)
            mean = total * by_n
            sigma = math.sqrt(max(squares * by_n - mean * mean, 0.0))
            out[y, x] = (image[y, x] - mean) / max(sigma, min_sigma)
    return out


# ---- gradients --------------------------------------------------------------------------------------------------


@njit(**OPTIONS)
def _around(image):
    """Return an image (H, W) with a pixel more on each side (H + 2, W + 2): the outer rows repeat, the columns wrap."""
    H, W = image.shape
    wide = np.empty((H + 2, W + 2), image.dtype)
    for y in range(H + 2):
        source, row = image[min(max(y - 1, 0), H - 1)], wide[y]
        row[0], row[W + 1] = source[W - 1], source[0]
        for x in range(W):
            row[x + 1] = source[x]
    return wide


@njit(**OPTIONS)
def _sobel(image, gx, gy):
    """Write horizontal and vertical Sobel sums of image (H, W)."""
    H, W = image.shape
    wide, two = _around(image), np.float32(2.0)
    for y in range(H):
        a, b, c = wide[y], wide[y + 1], wide[y + 2]
        for x in range(W):
            gx[y, x] = a[x + 2] - a[x] + two * (b[x + 2] - b[x]) + c[x + 2] - c[x]
            gy[y, x] = c[x] - a[x] + two * (c[x + 1] - a[x + 1]) + c[x + 2] - a[x + 2]


@njit(**OPTIONS)
def _to_unit(mask, x, y, magnitude):
    """Turn gradients x, y (H, W) into directions in place, 0 outside mask, write magnitudes, which sum to 1."""
    total = 0.0
    H, W = x.shape
    for v in range(H):
        part = np.float32(0.0)
        for u in range(W):
            m = math.sqrt(x[v, u] * x[v, u] + y[v, u] * y[v, u])
            m = m if (m > MIN_GRADIENT) & mask[v, u] else np.float32(0.0)
            inverse = np.float32(1.0) / m if m > 0 else np.float32(0.0)
            x[v, u] *= inverse
            y[v, u] *= inverse
            magnitude[v, u] = m
            part += m
        total += part
    if total > 0:
        scale = np.float32(1.0 / total)
        for v in range(H):
            for u in range(W):
                magnitude[v, u] *= scale


@njit(**OPTIONS)
def _inner(mask):
    """Return which pixels (H, W) have all 3 x 3 around them in mask (H, W); what is above and below counts."""
    H, W = mask.shape
    wide, inner = _around(mask), np.ones((H, W), np.bool_)
    for y in range(H):
        for i in range(3):
            row = wide[y + i]
            for x in range(W):
                inner[y, x] &= row[x] & row[x + 1] & row[x + 2]
    return inner


@njit(**OPTIONS)
def visual_gradients(gray, seen):
    """Return direction x, y, magnitude (H, W) f4 summing to 1, and which pixels (H, W) saw all that they used."""
    H, W = gray.shape
    inner = _inner(seen)
    gx, gy, magnitude = np.empty((H, W), np.float32), np.empty((H, W), np.float32), np.empty((H, W), np.float32)
    _sobel(gray, gx, gy)
    _to_unit(inner, gx, gy, magnitude)
    return gx, gy, magnitude, inner


@njit(**OPTIONS)
def _bound(range_m, sky_far, far):
    """Return a copy of range_m (H, W) within its limits; +Inf, and unknown sky if asked, are far."""
    H, W = range_m.shape
    out = np.empty((H, W), np.float32)
    in_sky = np.full(W, sky_far)
    for y in range(H):
        for x in range(W):
            r = range_m[y, x]
            if math.isnan(r):
                r = far if in_sky[x] else r
            else:
                in_sky[x] = False
                r = min(max(r, MIN_RANGE), far)
            out[y, x] = r
    return out


@njit(**OPTIONS)
def depth_gradients(range_m, sky_far, measured_only, far, k, min_sigma):
    """Return direction x, y and magnitude (H, W) f4 of a range panorama (H, W) f4 in m.

    measured_only: none where a pixel that it uses is unknown, and so are all around that one.
    """
    image = _bound(range_m, sky_far, np.float32(far))
    measured = _inner(~_inner(np.isnan(image))) if measured_only else np.ones(image.shape, np.bool_)
    fill_nan(image)
    image = normalize_contrast(image, k, min_sigma)
    gx, gy, magnitude = np.empty_like(image), np.empty_like(image), np.empty_like(image)
    _sobel(image, gx, gy)
    _to_unit(measured, gx, gy, magnitude)
    return gx, gy, magnitude


@njit(**OPTIONS)
def encode_features(x, y, magnitude, directions, magnitudes):
    """Write features (H, W) in bytes; return the scale of the magnitudes."""
    H, W = x.shape
    largest = np.float32(0.0)
    for v in range(H):
        for u in range(W):
            largest = max(largest, magnitude[v, u])
    inverse = np.float32(1.0) / largest if largest > 0 else np.float32(0.0)
    by_step = np.float32(NUM_DIRECTIONS / math.pi)
    half = np.float32(0.5)
    for v in range(H):
        for u in range(W):
            angle = arctangent2(y[v, u], x[v, u])
            code = int((angle + PI if angle < 0 else angle) * by_step + half)
            code = code - NUM_DIRECTIONS if code >= NUM_DIRECTIONS else code
            has_none = x[v, u] == 0 and y[v, u] == 0
            directions[v, u] = np.uint8(NO_DIRECTION if has_none else code)
            magnitudes[v, u] = np.uint8(np.float32(255.0) * math.sqrt(magnitude[v, u] * inverse) + half)
    return largest


@njit(parallel=True, **OPTIONS)
def encode_depth_many(ranges_m, sky_far, measured_only, far, k, min_sigma):
    """Return directions, magnitudes (M, H, W) u1 and scales (M,) f4 of range panoramas (M, H, W) f4 in m."""
    directions, magnitudes = np.empty(ranges_m.shape, np.uint8), np.empty(ranges_m.shape, np.uint8)
    scales = np.empty(len(ranges_m), np.float32)
    for i in prange(len(ranges_m)):
        x, y, m = depth_gradients(ranges_m[i], sky_far, measured_only, far, k, min_sigma)
        scales[i] = encode_features(x, y, m, directions[i], magnitudes[i])
    return directions, magnitudes, scales


# ---- eq. 2 ------------------------------------------------------------------------------------------------------


@njit(**OPTIONS)
def _add_row(vx, vy, vm, dx, dy, dm, sums):
    """Add the terms of eq. 2 of one row for all rotations; v (W,), d (2W,) repeated, sums (num_alpha, 3)."""
    W = len(vx)
    num_alpha = len(sums)
    for i in range(num_alpha):
        offset = W - i * (W // num_alpha)
        x, y, m = dx[offset : offset + W], dy[offset : offset + W], dm[offset : offset + W]
        visual, depth = np.float32(0.0), np.float32(0.0)
        for u in range(W):
            c = abs(vx[u] * x[u] + vy[u] * y[u])
            visual += c * vm[u]
            depth += c * m[u]
        sums[i, 0] += visual
        sums[i, 1] += depth


@njit(**OPTIONS)
def _add_seen(seen, dm, sums):
    """Add up the depth gradients that are in view for all rotations; seen (W,), dm (2W,)."""
    W = len(seen)
    num_alpha = len(sums)
    for i in range(num_alpha):
        offset = W - i * (W // num_alpha)
        m = dm[offset : offset + W]
        total = np.float32(0.0)
        for u in range(W):
            total += seen[u] * m[u]
        sums[i, 2] += total


@njit(**OPTIONS)
def _join_terms(sums, share, out):
    """Write s (num_alpha,) from sums (num_alpha, 3).

    Both magnitudes are to sum to 1: where the view is partial, those of the depth gradients in view do; a view
    with fewer of them than half of its share of the picture is taken to have that many.
    """
    for i in range(len(sums)):
        weight = 1.0
        if share < 1.0:
            weight = 1.0 / max(sums[i, 2], 0.5 * share)
        out[i] = sums[i, 0] + weight * sums[i, 1]


@njit(parallel=True, **OPTIONS)
def compare_headings_many(vx, vy, vm, seen, directions, magnitudes, scales, indices, num_alpha):
    """Return eq. 2 (M, num_alpha) f4 for the coded panoramas (N, H, W) of indices (M,)."""
    H, W = vx.shape
    out = np.empty((len(indices), num_alpha), np.float32)
    share = seen.mean() if seen.size > 0 else 1.0
    for i in prange(len(indices)):
        j = indices[i]
        sums = np.zeros((num_alpha, 3))
        rows = np.empty((3, 2 * W), np.float32)
        for y in range(H):
            for x in range(W):
                direction, m = directions[j, y, x], scales[j] * SQUARES[magnitudes[j, y, x]]
                rows[0, x] = rows[0, W + x] = COSINES[direction]
                rows[1, x] = rows[1, W + x] = SINES[direction]
                rows[2, x] = rows[2, W + x] = m
            _add_row(vx[y], vy[y], vm[y], rows[0], rows[1], rows[2], sums)
            if seen.size > 0:
                _add_seen(seen[y], rows[2], sums)
        _join_terms(sums, share, out[i])
    return out


# ---- correlation -------------------------------------------------------------------------------------------------


@njit(parallel=True, **OPTIONS)
def correlate_codes(codes, weights):
    """Return sum of weights (F, P) c8 times the conjugate of codes (F, N, 2 P) i1, real, then imaginary: (F, N) c8."""
    F, N, size = codes.shape
    half = size // 2
    out = np.empty((F, N), np.complex64)
    for f in prange(F):
        real, imaginary = np.empty(size, np.float32), np.empty(size, np.float32)
        for i in range(half):
            w = weights[f, i]
            real[i], real[half + i] = w.real, w.imag
            imaginary[i], imaginary[half + i] = w.imag, -w.real
        for n in range(N):
            row = codes[f, n]
            a, b = np.float32(0.0), np.float32(0.0)
            for i in range(size):
                value = np.float32(row[i])
                a += value * real[i]
                b += value * imaginary[i]
            out[f, n] = complex(a, b)
    return out
