"""The inner loops of direct registration. Plain arrays in and out; `warm_up` compiles them.

Arrays of points and gradients are (3, N) float32, one row a coordinate, so that every loop over pixels is a loop
over contiguous floats. Work is cut into at most `NUM_CHUNKS` pieces summed in fixed order: results do not depend on
the number of threads. A piece is processed in blocks of `BLOCK` pixels whose intermediate rows stay in the first
level cache. Definitions of the projections are in sphere_geometry; the tests hold the two together.
"""

import math
import os

import numpy as np
from numba import njit, prange

# Threads that spin while they wait stall every other process of a small vehicle computer; read when a kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

FAST = {"contract", "reassoc", "nsz", "arcp"}  # never nnan: NaN marks what is not visible
OPTIONS = {"cache": True, "fastmath": FAST, "error_model": "numpy", "nogil": True}

NUM_CHUNKS = 16
BLOCK = 512
PIECE = 2048  # smallest number of pixels worth a piece of its own
MIN_PARALLEL = 4  # pieces from which waking a second thread pays
NUM_SCRATCH = 24
BINS_PER_GREY = 4.0
HALF_RANGE = 256.0  # residuals beyond +-256 grey levels count into the outermost bins
NUM_BINS = int(2 * HALF_RANGE * BINS_PER_GREY)
NUM_COLUMNS = 8  # v (3), omega (3), gain, bias
NUM_SUMS = 45 + 2  # products of 9 columns (the residual is the ninth) by rows of the upper triangle, sum w, inliers

PINHOLE, FISHEYE, SPHERICAL = 0, 1, 2
MODELS = {"pinhole": PINHOLE, "fisheye": FISHEYE, "spherical": SPHERICAL}
MIN_DEPTH = np.float32(1e-6)
PI = np.float32(math.pi)
HALF_PI = np.float32(math.pi / 2)


@njit(**OPTIONS)
def _arctangent2(y, x):
    """Four-quadrant arctangent in float32, error below 3e-7 rad, made of operations that vectorise."""
    ax, ay = abs(x), abs(y)
    large, small = max(ax, ay), min(ax, ay)
    t = small / max(large, np.float32(1e-30))
    shifted = t > np.float32(0.41421356)
    s = (t - np.float32(1.0)) / (t + np.float32(1.0)) if shifted else t
    q = s * s
    p = np.float32(8.05374449538e-2) * q - np.float32(1.38776856032e-1)
    p = (p * q + np.float32(1.99777106478e-1)) * q - np.float32(3.33329491539e-1)
    a = p * q * s + s + (np.float32(math.pi / 4) if shifted else np.float32(0.0))
    a = HALF_PI - a if ay > ax else a
    a = PI - a if x < 0 else a
    return -a if y < 0 else a


@njit(**OPTIONS)
def _project_pinhole(k, n, x, y, z, u, v, J):
    """Points (B,) to pixels and J (6, B); NaN behind the camera and beyond the largest radius."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, max_r2 = k
    J0, J1, J2, J3, J4, J5 = J
    if k1 == 0 and k2 == 0 and p1 == 0 and p2 == 0 and k3 == 0 and k4 == 0 and k5 == 0 and k6 == 0:
        for i in range(n):
            w = np.float32(1.0) / z[i] if z[i] > MIN_DEPTH else np.float32(np.nan)
            xn, yn = x[i] * w, y[i] * w
            u[i], v[i] = fx * xn + cx, fy * yn + cy
            J0[i], J1[i], J2[i] = fx * w, np.float32(0.0), -fx * xn * w
            J3[i], J4[i], J5[i] = np.float32(0.0), fy * w, -fy * yn * w
        return
    two, three = np.float32(2.0), np.float32(3.0)
    for i in range(n):
        w = np.float32(1.0) / z[i] if z[i] > MIN_DEPTH else np.float32(np.nan)
        xn, yn = x[i] * w, y[i] * w
        r2 = xn * xn + yn * yn
        seen = r2 <= max_r2  # false for NaN too
        denominator = np.float32(1.0) / (np.float32(1.0) + r2 * (k4 + r2 * (k5 + r2 * k6)))
        radial = (np.float32(1.0) + r2 * (k1 + r2 * (k2 + r2 * k3))) * denominator
        slope = (k1 + r2 * (two * k2 + three * r2 * k3)) - radial * (k4 + r2 * (two * k5 + three * r2 * k6))
        slope = slope * denominator * two
        un = xn * radial + two * p1 * xn * yn + p2 * (r2 + two * xn * xn)
        vn = yn * radial + p1 * (r2 + two * yn * yn) + two * p2 * xn * yn
        u[i], v[i] = fx * un + cx if seen else np.float32(np.nan), fy * vn + cy
        dxx = radial + xn * xn * slope + two * p1 * yn + np.float32(6.0) * p2 * xn
        dxy = xn * yn * slope + two * p1 * xn + two * p2 * yn
        dyy = radial + yn * yn * slope + np.float32(6.0) * p1 * yn + two * p2 * xn
        J0[i], J1[i], J2[i] = fx * dxx * w, fx * dxy * w, -fx * (dxx * xn + dxy * yn) * w
        J3[i], J4[i], J5[i] = fy * dxy * w, fy * dyy * w, -fy * (dxy * xn + dyy * yn) * w


@njit(**OPTIONS)
def _project_fisheye(k, n, x, y, z, u, v, J):
    """Points (B,) to pixels and J (6, B); NaN beyond the largest angle."""
    fx, fy, cx, cy, k1, k2, k3, k4, max_angle = k
    J0, J1, J2, J3, J4, J5 = J
    one = np.float32(1.0)
    for i in range(n):
        sine = max(np.float32(math.sqrt(x[i] * x[i] + y[i] * y[i])), np.float32(1e-9))
        square = sine * sine + z[i] * z[i]
        angle = _arctangent2(sine, z[i])
        seen = angle <= max_angle
        a2 = angle * angle
        radius = angle * (one + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
        slope = np.float32(5.0) * k2 + a2 * (np.float32(7.0) * k3 + a2 * np.float32(9.0) * k4)
        slope = one + a2 * (np.float32(3.0) * k1 + a2 * slope)
        cx1, cy1 = x[i] / sine, y[i] / sine
        u[i], v[i] = fx * radius * cx1 + cx if seen else np.float32(np.nan), fy * radius * cy1 + cy
        along, across, by_z = slope * z[i] / square, radius / sine, -slope * sine / square
        mixed = (along - across) * cx1 * cy1
        J0[i], J1[i], J2[i] = fx * (along * cx1 * cx1 + across * cy1 * cy1), fx * mixed, fx * by_z * cx1
        J3[i], J4[i], J5[i] = fy * mixed, fy * (along * cy1 * cy1 + across * cx1 * cx1), fy * by_z * cy1


@njit(**OPTIONS)
def _project_spherical(k, n, x, y, z, u, v, J):
    """Points (B,) to pixels of the window and J (6, B)."""
    full_width, full_height, offset_u, offset_v = k
    J0, J1, J2, J3, J4, J5 = J
    half = np.float32(0.5)
    by_angle = full_width / (PI + PI)
    for i in range(n):
        horizontal2 = max(x[i] * x[i] + y[i] * y[i], np.float32(1e-12))
        horizontal = np.float32(math.sqrt(horizontal2))
        column = (half * full_width - half - offset_u) - _arctangent2(y[i], x[i]) * by_angle
        column = column + full_width if column < -half else column
        u[i] = column - full_width if column >= full_width - half else column
        v[i] = (half * full_height - half - offset_v) - _arctangent2(z[i], horizontal) * by_angle
        by_azimuth = by_angle / horizontal2
        by_elevation = by_angle / ((horizontal2 + z[i] * z[i]) * horizontal)
        J0[i], J1[i], J2[i] = by_azimuth * y[i], -by_azimuth * x[i], np.float32(0.0)
        J3[i], J4[i], J5[i] = by_elevation * x[i] * z[i], by_elevation * y[i] * z[i], -by_elevation * horizontal2


@njit(**OPTIONS)
def _project(model, k, n, x, y, z, u, v, J):
    if model == PINHOLE:
        _project_pinhole(
            (k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8], k[9], k[10], k[11], k[12]), n, x, y, z, u, v, J
        )
    elif model == FISHEYE:
        _project_fisheye((k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8]), n, x, y, z, u, v, J)
    else:
        _project_spherical((k[0], k[1], k[2], k[3]), n, x, y, z, u, v, J)


@njit(**OPTIONS)
def _transform(T, n, px, py, pz, x, y, z):
    """Move points by T (3, 4) into rows x, y, z."""
    r00, r01, r02, t0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    r10, r11, r12, t1 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    r20, r21, r22, t2 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    for i in range(n):
        x[i] = r00 * px[i] + r01 * py[i] + r02 * pz[i] + t0
        y[i] = r10 * px[i] + r11 * py[i] + r12 * pz[i] + t1
        z[i] = r20 * px[i] + r21 * py[i] + r22 * pz[i] + t2


@njit(**OPTIONS)
def _sample(image, pad, n, u, v, grey, gx, gy, visible):
    """Bilinear grey level and its exact derivative at (u, v); `pad` columns precede column 0 of the image."""
    last_u, last_v = np.float32(image.shape[1] - 1), np.float32(image.shape[0] - 1)
    shift = np.float32(pad)
    for i in range(n):
        uu, vv = u[i] + shift, v[i]
        if uu >= 0 and uu < last_u and vv >= 0 and vv < last_v:
            iu, iv = np.uint32(uu), np.uint32(vv)
            du, dv = uu - np.float32(iu), vv - np.float32(iv)
            a, b = np.float32(image[iv, iu]), np.float32(image[iv, iu + np.uint32(1)])
            c, d = np.float32(image[iv + np.uint32(1), iu]), np.float32(image[iv + np.uint32(1), iu + np.uint32(1)])
            top, bottom = a + du * (b - a), c + du * (d - c)
            grey[i] = top + dv * (bottom - top)
            gx[i] = (b - a) + dv * ((d - c) - (b - a))
            gy[i] = bottom - top
            visible[i] = np.float32(1.0)
        else:
            grey[i] = gx[i] = gy[i] = visible[i] = np.float32(0.0)


@njit(**OPTIONS)
def _weighted_sum(n, a, x, b, y, out):
    """Out is a x + b y. Short loops over few rows vectorise; one loop over all rows does not."""
    for i in range(n):
        out[i] = a[i] * x[i] + b[i] * y[i]


@njit(**OPTIONS)
def _cross(n, a, x, b, y, out):
    """Out is a x - b y, one component of a cross product."""
    for i in range(n):
        out[i] = a[i] * x[i] - b[i] * y[i]


@njit(**OPTIONS)
def _mean_gradient(n, r0, r1, r2, ax, ay, az, reference, visible, out):
    """One component of half the sum of the reference's gradient and the current one turned into its frame."""
    half = np.float32(0.5)
    for i in range(n):
        mean = half * (reference[i] + (r0 * ax[i] + r1 * ay[i] + r2 * az[i]))
        out[i] = mean if visible[i] > 0 else np.float32(0.0)  # behind the camera `mean` is NaN


@njit(**OPTIONS)
def _residual(n, gain, bias, grey, intensity, visible, out):
    for i in range(n):
        out[i] = gain * grey[i] + bias - intensity[i] if visible[i] > 0 else np.float32(np.nan)


@njit(**OPTIONS)
def _combine(T, gain, bias, n, intensity, bx, by, bz, rows, residual, ox, oy, oz):
    """Residual and ESM gradient by the reference point, half the sum of both images' (M15 eq. 6, 30)."""
    gx, gy, visible = rows[6], rows[7], rows[8]
    ax, ay, az = rows[15], rows[16], rows[17]
    _residual(n, gain, bias, rows[5], intensity, visible, residual)
    _weighted_sum(n, gx, rows[9], gy, rows[12], ax)
    _weighted_sum(n, gx, rows[10], gy, rows[13], ay)
    _weighted_sum(n, gx, rows[11], gy, rows[14], az)
    _mean_gradient(n, gain * T[0, 0], gain * T[1, 0], gain * T[2, 0], ax, ay, az, bx, visible, ox)
    _mean_gradient(n, gain * T[0, 1], gain * T[1, 1], gain * T[2, 1], ax, ay, az, by, visible, oy)
    _mean_gradient(n, gain * T[0, 2], gain * T[1, 2], gain * T[2, 2], ax, ay, az, bz, visible, oz)


@njit(**OPTIONS)
def _count(n, residual, counts):
    """Add the visible residuals to a histogram (NUM_BINS,)."""
    for i in range(n):
        e = residual[i]
        if e == e:
            scaled = (e + np.float32(HALF_RANGE)) * np.float32(BINS_PER_GREY)
            counts[np.uint32(min(max(scaled, np.float32(0.0)), np.float32(NUM_BINS - 1)))] += 1


@njit(**OPTIONS)
def _linearise_piece(
    first,
    last,
    points,
    intensity,
    reference_gradient,
    T,
    model,
    k,
    image,
    pad,
    gain,
    bias,
    rows,
    residual,
    gradient,
    counts,
):
    """Warp, sample, subtract, differentiate pixels first..last; count their residuals."""
    counts[:] = 0
    J = (rows[9], rows[10], rows[11], rows[12], rows[13], rows[14])
    bx, by, bz = reference_gradient[0], reference_gradient[1], reference_gradient[2]
    ox, oy, oz = gradient[0], gradient[1], gradient[2]
    for a in range(first, last, BLOCK):
        b = min(a + BLOCK, last)
        n = b - a
        _transform(T, n, points[0][a:b], points[1][a:b], points[2][a:b], rows[0], rows[1], rows[2])
        _project(model, k, n, rows[0], rows[1], rows[2], rows[3], rows[4], J)
        _sample(image, pad, n, rows[3], rows[4], rows[5], rows[6], rows[7], rows[8])
        e = residual[a:b]
        _combine(T, gain, bias, n, intensity[a:b], bx[a:b], by[a:b], bz[a:b], rows, e, ox[a:b], oy[a:b], oz[a:b])
        _count(n, e, counts)


@njit(**OPTIONS)
def num_pieces(n):
    """In how many pieces n pixels are cut: by their number alone, so that results do not depend on the machine."""
    return max(1, min(NUM_CHUNKS, n // PIECE))


@njit(parallel=True, **OPTIONS)
def _linearise_in_parallel(
    points, intensity, reference_gradient, T, model, k, image, pad, gain, bias, scratch, residual, gradient, histogram
):
    n, pieces = intensity.shape[0], num_pieces(intensity.shape[0])
    for c in prange(pieces):
        _linearise_piece(
            n * c // pieces,
            n * (c + 1) // pieces,
            points,
            intensity,
            reference_gradient,
            T,
            model,
            k,
            image,
            pad,
            gain,
            bias,
            scratch[c],
            residual,
            gradient,
            histogram[c],
        )


@njit(**OPTIONS)
def linearise(
    points, intensity, reference_gradient, T, model, k, image, pad, gain, bias, scratch, residual, gradient, histogram
):
    """Warp, sample, subtract, differentiate (M15 eq. 4, 6).

    points, reference_gradient (3, N) f32; intensity (N,) f32; T (3, 4) f32 reference -> camera; image (H, W) u8 | f32.
    Writes residual (N,) f32 (NaN: not visible), gradient (3, N) f32 in grey levels per metre in the reference frame
    and histogram (NUM_CHUNKS, NUM_BINS) i32 of the visible residuals, its first `num_pieces` rows.
    scratch is (NUM_CHUNKS, NUM_SCRATCH, BLOCK) f32.
    """
    if num_pieces(intensity.shape[0]) >= MIN_PARALLEL:
        _linearise_in_parallel(
            points,
            intensity,
            reference_gradient,
            T,
            model,
            k,
            image,
            pad,
            gain,
            bias,
            scratch,
            residual,
            gradient,
            histogram,
        )
        return
    n, pieces = intensity.shape[0], num_pieces(intensity.shape[0])
    for c in range(pieces):
        _linearise_piece(
            n * c // pieces,
            n * (c + 1) // pieces,
            points,
            intensity,
            reference_gradient,
            T,
            model,
            k,
            image,
            pad,
            gain,
            bias,
            scratch[c],
            residual,
            gradient,
            histogram[c],
        )


@njit(**OPTIONS)
def median_and_mad(histogram):
    """Median and median absolute deviation of a residual histogram (C, NUM_BINS) i32, and the number counted.

    Linear within a bin, so both are exact to a small part of 1 / BINS_PER_GREY (M15 eq. 12, 35).
    """
    counts = np.zeros(NUM_BINS, np.int64)
    for chunk in range(histogram.shape[0]):
        for i in range(NUM_BINS):
            counts[i] += histogram[chunk, i]
    total = counts.sum()
    if total == 0:
        return 0.0, 0.0, 0
    half = total / 2.0
    below, b = 0, 0
    while below + counts[b] < half:
        below += counts[b]
        b += 1
    middle = b + (half - below) / counts[b]
    cumulative = np.zeros(NUM_BINS + 1)
    for i in range(NUM_BINS):
        cumulative[i + 1] = cumulative[i] + counts[i]
    low, high = 0.0, float(NUM_BINS)
    for _ in range(40):  # bisection on the half width that holds half of all
        width = 0.5 * (low + high)
        held = _counted_below(cumulative, middle + width) - _counted_below(cumulative, middle - width)
        if held < half:
            low = width
        else:
            high = width
    return middle / BINS_PER_GREY - HALF_RANGE, high / BINS_PER_GREY, total


@njit(**OPTIONS)
def _counted_below(cumulative, position):
    if position <= 0:
        return 0.0
    if position >= NUM_BINS:
        return cumulative[NUM_BINS]
    b = int(position)
    return cumulative[b] + (position - b) * (cumulative[b + 1] - cumulative[b])


@njit(**OPTIONS)
def _weigh(n, residual, median, width, error, weight):
    """Residuals with 0 for what is not visible, their Huber weights (M15 eq. 34); returns the number of inliers."""
    inliers = np.float32(0.0)
    for i in range(n):
        seen = residual[i] == residual[i]
        e = residual[i] if seen else np.float32(0.0)
        off = abs(e - median)
        error[i] = e
        weight[i] = width / max(off, width) if seen else np.float32(0.0)
        inliers += np.float32(1.0) if (seen and off <= width) else np.float32(0.0)
    return inliers


@njit(**OPTIONS)
def _columns(n, px, py, pz, intensity, gx, gy, gz, gain, bias, rows):
    """Columns of J into rows 0..7: gradient, point x gradient, current grey level, one. Row 8 holds the residual."""
    c0, c1, c2, light, one, error = rows[0], rows[1], rows[2], rows[6], rows[7], rows[8]
    by_gain = np.float32(1.0) / gain
    for i in range(n):
        c0[i], c1[i], c2[i] = gx[i], gy[i], gz[i]
    _cross(n, py, gz, pz, gy, rows[3])
    _cross(n, pz, gx, px, gz, rows[4])
    _cross(n, px, gy, py, gx, rows[5])
    for i in range(n):
        light[i] = (error[i] + intensity[i] - bias) * by_gain
        one[i] = np.float32(1.0)


@njit(**OPTIONS)
def _dot2(n, w, c, a, b):
    """Return sum w c a and sum w c b: two products share the loads of w and c."""
    s = t = np.float32(0.0)
    for i in range(n):
        wc = w[i] * c[i]
        s += wc * a[i]
        t += wc * b[i]
    return s, t


@njit(**OPTIONS)
def _dot3(n, w, c, a, b, d):
    s = t = r = np.float32(0.0)
    for i in range(n):
        wc = w[i] * c[i]
        s += wc * a[i]
        t += wc * b[i]
        r += wc * d[i]
    return s, t, r


@njit(**OPTIONS)
def _accumulate_piece(first, last, points, intensity, residual, gradient, median, width, gain, bias, rows, out):
    """Add the products of the weighted columns of pixels first..last."""
    out[:] = 0.0
    weight = rows[9]
    px, py, pz = points[0], points[1], points[2]
    gx, gy, gz = gradient[0], gradient[1], gradient[2]
    for a in range(first, last, BLOCK):
        b = min(a + BLOCK, last)
        m = b - a
        out[46] += _weigh(m, residual[a:b], median, width, rows[8], weight)
        _columns(m, px[a:b], py[a:b], pz[a:b], intensity[a:b], gx[a:b], gy[a:b], gz[a:b], gain, bias, rows)
        s = 0
        for c in range(NUM_COLUMNS + 1):  # row 8 is the residual: its products are J'We and e'We
            d = c
            while d + 2 <= NUM_COLUMNS:
                x, y, z = _dot3(m, weight, rows[c], rows[d], rows[d + 1], rows[d + 2])
                out[s] += x
                out[s + 1] += y
                out[s + 2] += z
                s, d = s + 3, d + 3
            if d + 1 <= NUM_COLUMNS:
                x, y = _dot2(m, weight, rows[c], rows[d], rows[d + 1])
                out[s] += x
                out[s + 1] += y
                s += 2
            elif d <= NUM_COLUMNS:
                out[s] += _dot2(m, weight, rows[c], rows[d], rows[d])[0]
                s += 1
        out[45] += _dot2(m, weight, rows[7], rows[7], rows[7])[0]


@njit(parallel=True, **OPTIONS)
def _accumulate_in_parallel(points, intensity, residual, gradient, median, width, gain, bias, scratch, sums):
    n, pieces = residual.shape[0], num_pieces(residual.shape[0])
    for c in prange(pieces):
        first, last = n * c // pieces, n * (c + 1) // pieces
        _accumulate_piece(
            first, last, points, intensity, residual, gradient, median, width, gain, bias, scratch[c], sums[c]
        )


@njit(**OPTIONS)
def accumulate(points, intensity, residual, gradient, median, width, gain, bias, scratch, sums):
    """Sum the robust normal equations (M15 eq. 6, 33-34) of one view, in the tangent (v, omega) of the reference.

    `width` is the Huber bound a sigma in grey levels. Writes sums (NUM_CHUNKS, NUM_SUMS) f64, its first `num_pieces`
    rows: for each of the 8 columns its products with itself, the later columns and the residual; then sum w, the
    number of inliers.
    """
    n, pieces = residual.shape[0], num_pieces(residual.shape[0])
    if pieces >= MIN_PARALLEL:
        _accumulate_in_parallel(points, intensity, residual, gradient, median, width, gain, bias, scratch, sums)
        return
    for c in range(pieces):
        first, last = n * c // pieces, n * (c + 1) // pieces
        _accumulate_piece(
            first, last, points, intensity, residual, gradient, median, width, gain, bias, scratch[c], sums[c]
        )


@njit(**OPTIONS)
def _to_camera_tangent(T, H, g):
    """Turn H (8, 8), g (8,) over x in T exp(x) into those over xi in T_world_camera exp(xi), in place (eq. 31-32).

    T (3, 4) is reference -> camera; x = -Ad(T^-1) xi.
    """
    A = np.zeros((8, 8))
    for i in range(3):
        for j in range(3):
            A[i, j] = A[3 + i, 3 + j] = -T[j, i]  # R' of the inverse
    t0, t1, t2 = T[0, 3], T[1, 3], T[2, 3]
    for i in range(3):  # [t']x R' with t' = -R' t is -R' [t]x
        a, b, c = T[0, i], T[1, i], T[2, i]
        A[i, 3], A[i, 4], A[i, 5] = b * t2 - c * t1, c * t0 - a * t2, a * t1 - b * t0
    A[6, 6] = A[7, 7] = 1.0
    H[:] = A.T @ (H @ A)
    g[:] = A.T @ g


@njit(**OPTIONS)
def normal_equations(
    points, intensity, reference_gradient, T, model, k, image, pad, gain, bias, huber, min_sigma,
    scratch, residual, gradient, histogram, sums, H, g,
):  # fmt: skip
    """One view from pixels to robust normal equations in the tangent of the camera (M15 eq. 4, 6, 31-35).

    T (3, 4) f64; arrays as in `linearise` and `accumulate`. Writes H (8, 8), g (8,) f64 over (v, omega, gain, bias);
    returns median, MAD, number of visible pixels, number of inliers.
    """
    T32, gain32, bias32 = T.astype(np.float32), np.float32(gain), np.float32(bias)
    linearise(
        points,
        intensity,
        reference_gradient,
        T32,
        model,
        k,
        image,
        pad,
        gain32,
        bias32,
        scratch,
        residual,
        gradient,
        histogram,
    )
    pieces = num_pieces(intensity.shape[0])
    median, mad, number = median_and_mad(histogram[:pieces])
    width = huber * max(1.4826 * mad, min_sigma)
    accumulate(
        points, intensity, residual, gradient, np.float32(median), np.float32(width), gain32, bias32, scratch, sums
    )
    for s in range(NUM_SUMS):
        for c in range(1, pieces):
            sums[0, s] += sums[c, s]
    s = 0
    for a in range(NUM_COLUMNS):
        for b in range(a, NUM_COLUMNS):
            H[a, b] = H[b, a] = sums[0, s]
            s += 1
        g[a] = sums[0, s]
        s += 1
    _to_camera_tangent(T, H, g)
    return median, mad, number, np.int64(sums[0, 46])


@njit(parallel=True, **OPTIONS)
def halve(image, out):
    """Next pyramid level of image (H, W) u8 | f32: weights 1 3 3 1 over 8 both ways, centred between pixels.

    out is (H // 2, W // 2) f32. The border repeats; a whole sphere is padded by its caller.
    """
    rows, columns = out.shape
    width, height = image.shape[1], image.shape[0]
    for chunk in prange(NUM_CHUNKS):
        line = np.empty(width + 2, np.float32)
        for v in range(rows * chunk // NUM_CHUNKS, rows * (chunk + 1) // NUM_CHUNKS):
            a, b = image[max(2 * v - 1, 0)], image[2 * v]
            c, d = image[2 * v + 1], image[min(2 * v + 2, height - 1)]
            inner = line[1:]
            for u in range(width):
                inner[u] = (np.float32(a[u]) + np.float32(d[u])) + np.float32(3.0) * (
                    np.float32(b[u]) + np.float32(c[u])
                )
            line[0], line[width + 1] = line[1], line[width]
            target = out[v]
            for u in range(columns):
                outer = line[2 * u] + line[2 * u + 3]
                target[u] = (outer + np.float32(3.0) * (line[2 * u + 1] + line[2 * u + 2])) * np.float32(1.0 / 64.0)


@njit(parallel=True, **OPTIONS)
def halve_range(range_m, ratio, out):
    """Next level of a range image (H, W) f32: the mean inverse range of the nearest surface in each 2 x 2 block.

    Ranges beyond `ratio` times the nearest belong to another surface and are left out, so no point hangs between
    two. NaN only where all four are NaN.
    """
    rows, columns = out.shape
    for chunk in prange(NUM_CHUNKS):
        for v in range(rows * chunk // NUM_CHUNKS, rows * (chunk + 1) // NUM_CHUNKS):
            a, b, target = range_m[2 * v], range_m[2 * v + 1], out[v]
            for u in range(columns):
                four = (a[2 * u], a[2 * u + 1], b[2 * u], b[2 * u + 1])
                nearest = np.float32(np.inf)
                number = np.float32(0.0)
                for r in four:
                    if r == r:
                        number += np.float32(1.0)
                        nearest = min(nearest, r)
                inverse, used = np.float32(0.0), np.float32(0.0)
                for r in four:
                    if r <= nearest * ratio:
                        inverse += np.float32(1.0) / r
                        used += np.float32(1.0)
                if number == 0:
                    target[u] = np.float32(np.nan)
                elif inverse == 0:
                    target[u] = np.float32(np.inf)
                else:
                    target[u] = used / inverse


@njit(parallel=True, **OPTIONS)
def reference_points(index, rays, range_m, far, image, pad, model, k, scratch, points, intensity, gradient):
    """Points, grey levels and gradients by the point (M15 eq. 30, at the reference itself) of chosen pixels.

    index (N,) i64 into the flat image, no pixel of the first or last row or (unpadded) column; rays (3, H W) f32;
    range_m (H W,) f32; image (H, W + 2 pad) f32 | u8. Writes points, gradient (3, N) f32, intensity (N,) f32.
    """
    n = index.shape[0]
    width = image.shape[1] - 2 * pad
    half = np.float32(0.5)
    for chunk in prange(NUM_CHUNKS):
        rows = scratch[chunk]
        J = (rows[9], rows[10], rows[11], rows[12], rows[13], rows[14])
        last = n * (chunk + 1) // NUM_CHUNKS
        for a in range(n * chunk // NUM_CHUNKS, last, BLOCK):
            m = min(BLOCK, last - a)
            x, y, z = points[0][a : a + m], points[1][a : a + m], points[2][a : a + m]
            for i in range(m):
                pixel = index[a + i]
                v, u = pixel // width, pixel % width + pad
                distance = min(range_m[pixel], far)
                x[i], y[i], z[i] = rays[0, pixel] * distance, rays[1, pixel] * distance, rays[2, pixel] * distance
                intensity[a + i] = np.float32(image[v, u])
                rows[6, i] = half * (np.float32(image[v, u + 1]) - np.float32(image[v, u - 1]))
                rows[7, i] = half * (np.float32(image[v + 1, u]) - np.float32(image[v - 1, u]))
            _project(model, k, m, x, y, z, rows[3], rows[4], J)
            for i in range(m):
                gradient[0, a + i] = rows[6, i] * rows[9, i] + rows[7, i] * rows[12, i]
                gradient[1, a + i] = rows[6, i] * rows[10, i] + rows[7, i] * rows[13, i]
                gradient[2, a + i] = rows[6, i] * rows[11, i] + rows[7, i] * rows[14, i]


NUM_KEYS = 1 << 12  # 32 octaves of |J| in 128 steps each: order within 0.8 %, counters fit the first level cache
LOWEST_KEY = (127 - 12) << 7  # bits of 2^-12; what is smaller is all the same
HIGHEST_KEY = LOWEST_KEY + NUM_KEYS - 1


@njit(**OPTIONS)
def _sort_column(j, p, g, key, order, limit):
    """Counting sort of one column by the upper bits of the float, largest first, as far as `limit` places."""
    n = key.shape[0]
    value = np.empty(n, np.float32)
    if j < 3:
        for i in range(n):
            value[i] = g[j, i]
    else:
        a, b = (j - 2) % 3, (j - 1) % 3
        pa, pb, ga, gb = p[a], p[b], g[a], g[b]
        for i in range(n):
            value[i] = pa[i] * gb[i] - pb[i] * ga[i]
    bits = value.view(np.int32)
    starts = np.zeros(NUM_KEYS + 1, np.int32)
    for i in range(n):
        exponent = (bits[i] & 0x7FFFFFFF) >> 16
        key[i] = np.uint16(HIGHEST_KEY - min(max(exponent, LOWEST_KEY), HIGHEST_KEY))
        starts[np.uint32(key[i]) + np.uint32(1)] += 1
    for b in range(NUM_KEYS):
        starts[b + 1] += starts[b]
    for i in range(n):
        k = np.uint32(key[i])
        if starts[k] < limit:
            order[starts[k]] = i
        starts[k] += 1


@njit(parallel=True, **OPTIONS)
def sort_columns(points, gradient, keys, order):
    """Sort the pixels by each of the six steepest-descent columns |J^j| (M15 eq. 14), largest first.

    keys (6, N) u16 scratch; writes order (6, L) u32, the first L <= N of each. Columns are in order to within 0.8 %,
    equal keys in order of the pixels.
    """
    for j in prange(6):
        _sort_column(np.int64(j), points, gradient, keys[j], order[j], order.shape[1])


@njit(**OPTIONS)
def pick_in_turn(order, rank):
    """Give each pixel its place when the columns pick their best remaining pixel in turn (M15 alg. 1).

    order (6, L) u32 from `sort_columns`; writes rank (N,) i32. With L < N the pixels after the first L places keep
    the order of the image.
    """
    limit = order.shape[1]
    rank[:] = -1
    heads = np.zeros(6, np.int64)
    place = 0
    while place < limit:
        for j in range(6):
            while heads[j] < limit and rank[order[j, heads[j]]] >= 0:
                heads[j] += 1
            if heads[j] < limit and place < limit:
                rank[order[j, heads[j]]] = place
                place += 1
    for i in range(rank.shape[0]):
        if rank[i] < 0:
            rank[i] = place
            place += 1


@njit(**OPTIONS)
def _seen(T, model, k, width, height, n, px, py, pz, rows, seen):
    """Which points fall into an image of width x height by T."""
    J = (rows[9], rows[10], rows[11], rows[12], rows[13], rows[14])
    _transform(T, n, px, py, pz, rows[0], rows[1], rows[2])
    _project(model, k, n, rows[0], rows[1], rows[2], rows[3], rows[4], J)
    u, v = rows[3], rows[4]
    for i in range(n):
        seen[i] = u[i] >= 0 and u[i] <= width - 1 and v[i] >= 0 and v[i] <= height - 1


@njit(parallel=True, **OPTIONS)
def find_visible(points, T, model, k, width, height, scratch, seen):
    """Mark in seen (N,) bool which points (3, N) project into the image."""
    n = seen.shape[0]
    w, h = np.float32(width), np.float32(height)
    for chunk in prange(NUM_CHUNKS):
        last = n * (chunk + 1) // NUM_CHUNKS
        for a in range(n * chunk // NUM_CHUNKS, last, BLOCK):
            b = min(a + BLOCK, last)
            p = (points[0][a:b], points[1][a:b], points[2][a:b])
            _seen(T, model, k, w, h, b - a, p[0], p[1], p[2], scratch[chunk], seen[a:b])


@njit(**OPTIONS)
def best_of(seen, rank, number):
    """Return the indices (<= number,) i64 of the seen pixels of the best rank, in order of the pixels (M15 eq. 16)."""
    n = seen.shape[0]
    by_rank = np.zeros(n, np.uint8)
    total = 0
    for i in range(n):
        if seen[i]:
            by_rank[rank[i]] = 1
            total += 1
    limit, kept = n, 0
    if total > number:
        limit = 0
        while kept < number:
            kept += by_rank[limit]
            limit += 1
    out = np.empty(min(total, number), np.int64)
    kept = 0
    for i in range(n):
        if seen[i] and rank[i] < limit:
            out[kept] = i
            kept += 1
    return out
