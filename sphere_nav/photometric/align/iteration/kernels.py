"""One pass over the pixels of one reference: warp and compare (M15 eq. 4), weigh (eq. 33-35), sum (eq. 6).

Pixels come in blocks of `SIDE`, seven rows side by side; what is computed of a block stays in the rows of one flat
array in the first level cache. All rows are at constant distances and all loops of constant length, so that the
compiler sees that nothing overlaps and vectorises every loop but the four loads of a pixel. A vectorisation that is
lost is silent: `python -m benchmarks times kernel_times` has a bound.

Definitions of the projections are in sphere_nav.geometry; the tests hold the two together.
"""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit

SIDE = 256  # pixels of a block
# Rows of a block of the reference: point in m, grey level, its gradient by the point in grey levels per m.
PX, PY, PZ, GRAY, BX, BY, BZ, BLOCK = (SIDE * i for i in range(8))
# Rows of the scratch: columns of the Jacobian (v, omega, gain; that of the bias is one), residual, weight, ...
C0, C1, C2, C3, C4, C5, C6, ERROR, WEIGHT, DU, DV, SEEN, J0, J1, J2, J3, J4, J5, TA, TB, TC, TD, SCRATCH = (
    SIDE * i for i in range(23)
)
X, Y, Z, U, V = C0, C1, C2, C3, C4  # in the camera frame and in pixels, until the columns take their place
NUM_COLUMNS = 8  # v (3), omega (3), gain, bias
NUM_SUMS = 45 + 2  # products of 9 columns, the residual the ninth, by rows of the upper triangle; visible, inliers
VISIBLE, INLIERS = 45, 46

BINS_PER_GRAY = 4.0
HALF_RANGE = 256.0  # residuals beyond +-256 grey levels count into the outermost bins
NUM_BINS = int(2 * HALF_RANGE * BINS_PER_GRAY)

PLANE, FISHEYE, SPHERICAL = 0, 1, 2
NUM_COEFFICIENTS = 17  # of the longest model
ZERO, HALF, ONE, TWO, THREE = (np.float32(i) for i in (0.0, 0.5, 1.0, 2.0, 3.0))
FOUR, SIX = np.float32(4.0), np.float32(6.0)
MIN_DEPTH = np.float32(1e-6)
MIN_SINE = np.float32(1e-9)
MAX_SQUARE = np.float32(1e4)  # squared tangent of the angle that is in no perspective image: 89.4 deg
PI = np.float32(math.pi)
HALF_PI, QUARTER_PI = np.float32(math.pi / 2), np.float32(math.pi / 4)


@njit(**OPTIONS)
def transform(T, d, r):
    """Move the points of a block by T (3, 4) f32."""
    r00, r01, r02, t0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    r10, r11, r12, t1 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    r20, r21, r22, t2 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    for i in range(SIDE):
        px, py, pz = d[PX + i], d[PY + i], d[PZ + i]
        r[X + i] = r00 * px + r01 * py + r02 * pz + t0
        r[Y + i] = r10 * px + r11 * py + r12 * pz + t1
        r[Z + i] = r20 * px + r21 * py + r22 * pz + t2


@njit(**OPTIONS)
def arctangent2(y, x):
    """Four-quadrant arctangent in float32, error below 3e-7 rad, made of operations that vectorise."""
    ax, ay = abs(x), abs(y)
    large, small = max(ax, ay), min(ax, ay)
    t = small / max(large, np.float32(1e-30))
    shifted = t > np.float32(0.41421356)
    s = (t - ONE) / (t + ONE) if shifted else t
    q = s * s
    p = np.float32(8.05374449538e-2) * q - np.float32(1.38776856032e-1)
    p = (p * q + np.float32(1.99777106478e-1)) * q - np.float32(3.33329491539e-1)
    a = p * q * s + s + (QUARTER_PI if shifted else ZERO)
    a = HALF_PI - a if ay > ax else a
    a = PI - a if x < ZERO else a
    return -a if y < ZERO else a


@njit(**OPTIONS)
def _project_undistorted(k, r):
    fx, fy, cx, cy = k[0], k[1], k[2], k[3]
    for i in range(SIDE):
        ahead = r[Z + i] > MIN_DEPTH  # false for NaN too
        w = ONE / (r[Z + i] if ahead else ONE)
        xn, yn = (r[X + i] if ahead else ZERO) * w, (r[Y + i] if ahead else ZERO) * w
        r[SEEN + i] = ONE if ahead else ZERO
        r[U + i], r[V + i] = fx * xn + cx, fy * yn + cy
        r[J0 + i], r[J1 + i], r[J2 + i] = fx * w, ZERO, -fx * xn * w
        r[J3 + i], r[J4 + i], r[J5 + i] = ZERO, fy * w, -fy * yn * w


@njit(**OPTIONS)
def _project_distorted(k, r):
    fx, fy, cx, cy, k1, k2, p1, p2 = k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7]
    k3, k4, k5, k6, max_r2 = k[8], k[9], k[10], k[11], min(k[12], MAX_SQUARE)
    for i in range(SIDE):
        ahead = r[Z + i] > MIN_DEPTH
        w = ONE / (r[Z + i] if ahead else ONE)
        xn, yn = (r[X + i] if ahead else ZERO) * w, (r[Y + i] if ahead else ZERO) * w
        seen = ahead & (xn * xn + yn * yn <= max_r2)
        xn, yn = (xn if seen else ZERO), (yn if seen else ZERO)  # no power of it may overflow
        r2 = xn * xn + yn * yn
        r[SEEN + i] = ONE if seen else ZERO
        denominator = ONE / (ONE + r2 * (k4 + r2 * (k5 + r2 * k6)))
        radial = (ONE + r2 * (k1 + r2 * (k2 + r2 * k3))) * denominator
        slope = (k1 + r2 * (TWO * k2 + THREE * r2 * k3)) - radial * (k4 + r2 * (TWO * k5 + THREE * r2 * k6))
        slope = slope * denominator * TWO
        un = xn * radial + TWO * p1 * xn * yn + p2 * (r2 + TWO * xn * xn)
        vn = yn * radial + p1 * (r2 + TWO * yn * yn) + TWO * p2 * xn * yn
        r[U + i], r[V + i] = fx * un + cx, fy * vn + cy
        dxx = radial + xn * xn * slope + TWO * p1 * yn + SIX * p2 * xn
        dxy = xn * yn * slope + TWO * p1 * xn + TWO * p2 * yn
        dyy = radial + yn * yn * slope + SIX * p1 * yn + TWO * p2 * xn
        r[J0 + i], r[J1 + i], r[J2 + i] = fx * dxx * w, fx * dxy * w, -fx * (dxx * xn + dxy * yn) * w
        r[J3 + i], r[J4 + i], r[J5 + i] = fy * dxy * w, fy * dyy * w, -fy * (dxy * xn + dyy * yn) * w


@njit(**OPTIONS)
def _project_fisheye(k, r):
    """Lenses whose image radius is a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) of the angle a from the axis.

    k: fx, fy, cx, cy, k1, k2, k3, k4, largest angle.
    """
    fx, fy, cx, cy, k1, k2, k3, k4, max_angle = k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8]
    for i in range(SIDE):
        known = r[Z + i] == r[Z + i]
        x, y, z = (r[X + i] if known else ZERO), (r[Y + i] if known else ZERO), (r[Z + i] if known else ONE)
        sine = max(np.float32(math.sqrt(x * x + y * y)), MIN_SINE)
        angle = arctangent2(sine, z)
        seen = known & (angle <= max_angle) & ((sine > MIN_SINE) | (z > ZERO))  # straight behind is a whole circle
        r[SEEN + i] = ONE if seen else ZERO
        a2 = angle * angle
        share = ONE + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))
        slope = share + TWO * a2 * (k1 + a2 * (TWO * k2 + a2 * (THREE * k3 + a2 * FOUR * k4)))
        by_both = ONE / (sine * (sine * sine + z * z))
        by_sine, by_square = (sine * sine + z * z) * by_both, sine * by_both
        radius, xn, yn = share * angle, x * by_sine, y * by_sine
        along, across, by_z = slope * z * by_square, radius * by_sine, -slope * sine * by_square
        mixed = (along - across) * xn * yn
        r[U + i], r[V + i] = fx * radius * xn + cx, fy * radius * yn + cy
        r[J0 + i], r[J1 + i], r[J2 + i] = fx * (along * xn * xn + across * yn * yn), fx * mixed, fx * by_z * xn
        r[J3 + i], r[J4 + i], r[J5 + i] = fy * mixed, fy * (along * yn * yn + across * xn * xn), fy * by_z * yn


@njit(**OPTIONS)
def _project_spherical(k, r):
    """Project into the window of a sphere."""
    full_width, full_height, offset_u, offset_v = k[0], k[1], k[2], k[3]
    by_angle = full_width / (PI + PI)
    center_u, center_v = HALF * full_width - HALF - offset_u, HALF * full_height - HALF - offset_v
    for i in range(SIDE):
        known = r[Z + i] == r[Z + i]
        x, y, z = (r[X + i] if known else ONE), (r[Y + i] if known else ZERO), (r[Z + i] if known else ZERO)
        r[SEEN + i] = ONE if known else ZERO
        horizontal2 = max(x * x + y * y, np.float32(1e-12))
        horizontal = np.float32(math.sqrt(horizontal2))
        column = center_u - arctangent2(y, x) * by_angle
        column = column + full_width if column < -HALF else column
        r[U + i] = column - full_width if column >= full_width - HALF else column
        r[V + i] = center_v - arctangent2(z, horizontal) * by_angle
        by_azimuth = by_angle / horizontal2
        by_elevation = by_angle / ((horizontal2 + z * z) * horizontal)
        r[J0 + i], r[J1 + i], r[J2 + i] = by_azimuth * y, -by_azimuth * x, ZERO
        r[J3 + i], r[J4 + i], r[J5 + i] = by_elevation * x * z, by_elevation * y * z, -by_elevation * horizontal2


@njit(**OPTIONS)
def _shift(k, r):
    """Put in place of z what x and y are divided by where rays pass one sphere or two before the plane.

    That is alpha d2 + (1 - alpha) (z + xi d) with d2 = |(x, y, z + xi d)| (cameras/double_sphere.py).
    Its derivative by x, y, z goes to rows TA, TB, TC, z itself to TD.
    """
    xi, alpha, min_first, min_second = k[13], k[14], k[15], k[16]
    beta = ONE - alpha
    for i in range(SIDE):
        known = r[Z + i] == r[Z + i]
        x, y, z = (r[X + i] if known else ZERO), (r[Y + i] if known else ZERO), (r[Z + i] if known else ZERO)
        distance = max(np.float32(math.sqrt(x * x + y * y + z * z)), MIN_SINE)
        along = xi / distance  # d shifted / d point is along * point + (0, 0, 1)
        shifted = z + xi * distance
        second = max(np.float32(math.sqrt(x * x + y * y + shifted * shifted)), MIN_SINE)
        by_second = alpha / second
        by_shifted = by_second * shifted + beta
        seen = known & (z > min_first * distance) & (shifted > min_second * second)
        r[TD + i], r[Z + i] = r[Z + i], (alpha * second + beta * shifted if seen else ZERO)
        r[TA + i], r[TB + i] = (by_second + by_shifted * along) * x, (by_second + by_shifted * along) * y
        r[TC + i] = by_shifted * (along * z + ONE)


@njit(**OPTIONS)
def _unshift(r):
    """Turn the derivative by what `_shift` has put in place of z to one by the point."""
    for i in range(SIDE):
        u, v, r[Z + i] = r[J2 + i], r[J5 + i], r[TD + i]
        r[J0 + i], r[J1 + i], r[J2 + i] = r[J0 + i] + u * r[TA + i], r[J1 + i] + u * r[TB + i], u * r[TC + i]
        r[J3 + i], r[J4 + i], r[J5 + i] = r[J3 + i] + v * r[TA + i], r[J4 + i] + v * r[TB + i], v * r[TC + i]


@njit(**OPTIONS)
def project(model, k, r):
    """Rows X, Y, Z to pixels U, V and their derivative J by the point; SEEN is 1 where the model has a pixel."""
    if model == SPHERICAL:
        _project_spherical(k, r)
    elif model == FISHEYE:
        _project_fisheye(k, r)
    else:
        is_shifted = k[13] != ZERO or k[14] != ZERO
        if is_shifted:
            _shift(k, r)
        if k[4:12].any():
            _project_distorted(k, r)
        else:
            _project_undistorted(k, r)
        if is_shifted:
            _unshift(r)


@njit(**OPTIONS)
def _roll(shutter, r):
    """Move pixels by the motion of the camera between the middle row and their own, to first order.

    shutter (8,): twist (v, omega) within the readout, middle row, rows (cameras/rolling_shutter.py). A point p moves
    by -s (v + omega x p), its row from V to V - s dv; s is the share of that row.
    """
    vx, vy, vz, wx, wy, wz = shutter[0], shutter[1], shutter[2], shutter[3], shutter[4], shutter[5]
    middle, rows = shutter[6], shutter[7]
    for i in range(SIDE):
        seen = r[SEEN + i] > ZERO
        x, y, z = (r[X + i] if seen else ZERO), (r[Y + i] if seen else ZERO), (r[Z + i] if seen else ZERO)
        qx, qy, qz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
        du = r[J0 + i] * qx + r[J1 + i] * qy + r[J2 + i] * qz
        dv = r[J3 + i] * qx + r[J4 + i] * qy + r[J5 + i] * qz
        share = (r[V + i] - middle) / max(rows + dv, HALF * rows)
        r[U + i] -= share * du
        r[V + i] -= share * dv


@njit(**OPTIONS)
def _address(image, r, places):
    """Place of the upper left of the four pixels around (U, V), and how far beyond it; SEEN only within the image."""
    last_u, last_v = np.float32(image.width - 1), np.float32(image.height - 1)
    shift, stride = np.float32(image.pad), np.int32(image.width)
    for i in range(SIDE):
        u, v = r[U + i] + shift, r[V + i]
        inside = (r[SEEN + i] > ZERO) & (u >= ZERO) & (u < last_u) & (v >= ZERO) & (v < last_v)
        u, v = (u if inside else ZERO), (v if inside else ZERO)
        iu, iv = np.int32(u), np.int32(v)
        r[DU + i], r[DV + i] = u - np.float32(iu), v - np.float32(iv)
        r[SEEN + i] = ONE if inside else ZERO
        places[i] = iv * stride + iu


@njit(**OPTIONS)
def _gather(flat, stride, places, r):
    for i in range(SIDE):
        p = np.uint64(places[i])
        q = p + stride
        r[TA + i], r[TB + i] = np.float32(flat[p]), np.float32(flat[p + np.uint64(1)])
        r[TC + i], r[TD + i] = np.float32(flat[q]), np.float32(flat[q + np.uint64(1)])


@njit(**OPTIONS)
def _forget_unseen(r):
    """Nothing is seen where one of the four pixels is NaN: where no camera saw anything."""
    for i in range(SIDE):
        a, b, c, e = r[TA + i], r[TB + i], r[TC + i], r[TD + i]
        total = (a + b) + (c + e)
        known = total == total
        r[SEEN + i] = r[SEEN + i] if known else ZERO
        r[TA + i], r[TB + i] = (a if known else ZERO), (b if known else ZERO)
        r[TC + i], r[TD + i] = (c if known else ZERO), (e if known else ZERO)


@njit(**OPTIONS)
def locate(T, camera, image, d, r, places):
    """Warp a block and load the four grey levels around each of its pixels."""
    transform(T, d, r)
    project(camera[0], camera[1], r)
    if camera[2][7] > ZERO:
        _roll(camera[2], r)
    _address(image, r, places)
    if image.bytes.size:  # one kernel for both kinds of image: only the loads differ
        _gather(image.bytes, np.uint64(image.width), places, r)
    else:
        _gather(image.floats, np.uint64(image.width), places, r)
        _forget_unseen(r)


@njit(**OPTIONS)
def compare(gain, bias, d, r):
    """Grey level and residual alone of a located block: what the scale needs."""
    for i in range(SIDE):
        a, b, c, e = r[TA + i], r[TB + i], r[TC + i], r[TD + i]
        top, bottom = a + r[DU + i] * (b - a), c + r[DU + i] * (e - c)
        r[C6 + i] = top + r[DV + i] * (bottom - top)
        r[ERROR + i] = gain * r[C6 + i] + bias - d[GRAY + i]


@njit(**OPTIONS)
def _differentiate(T, gain, bias, d, r):
    """Residual and the first three columns: half the sum of both images' gradients by the point (M15 eq. 6, 30)."""
    by_gain = HALF * gain
    b00, b01, b02 = by_gain * T[0, 0], by_gain * T[0, 1], by_gain * T[0, 2]
    b10, b11, b12 = by_gain * T[1, 0], by_gain * T[1, 1], by_gain * T[1, 2]
    b20, b21, b22 = by_gain * T[2, 0], by_gain * T[2, 1], by_gain * T[2, 2]
    for i in range(SIDE):
        a, b, c, e = r[TA + i], r[TB + i], r[TC + i], r[TD + i]
        seen, du, dv = r[SEEN + i] > ZERO, r[DU + i], r[DV + i]
        top, bottom = a + du * (b - a), c + du * (e - c)
        gray = top + dv * (bottom - top)
        gx, gy = (b - a) + dv * ((e - c) - (b - a)), bottom - top
        gx, gy = (gx if seen else ZERO), (gy if seen else ZERO)
        ax = gx * r[J0 + i] + gy * r[J3 + i]
        ay = gx * r[J1 + i] + gy * r[J4 + i]
        az = gx * r[J2 + i] + gy * r[J5 + i]
        r[C0 + i] = HALF * d[BX + i] + (b00 * ax + b10 * ay + b20 * az)
        r[C1 + i] = HALF * d[BY + i] + (b01 * ax + b11 * ay + b21 * az)
        r[C2 + i] = HALF * d[BZ + i] + (b02 * ax + b12 * ay + b22 * az)
        r[C6 + i] = gray
        r[ERROR + i] = gain * gray + bias - d[GRAY + i] if seen else ZERO


@njit(**OPTIONS)
def _weigh(median, width, d, r):
    """Huber weights (M15 eq. 34), 0 where not visible, and the columns of the rotation; return the inliers."""
    inliers = ZERO
    for i in range(SIDE):
        seen = r[SEEN + i] > ZERO
        off = abs(r[ERROR + i] - median)
        r[WEIGHT + i] = r[SEEN + i] * width / (off if off > width else width)
        inliers += ONE if seen & (off <= width) else ZERO
        px, py, pz = (d[PX + i] if seen else ZERO), (d[PY + i] if seen else ZERO), (d[PZ + i] if seen else ZERO)
        g0, g1, g2 = r[C0 + i], r[C1 + i], r[C2 + i]
        r[C3 + i], r[C4 + i], r[C5 + i] = py * g2 - pz * g1, pz * g0 - px * g2, px * g1 - py * g0
    return inliers


@njit(**OPTIONS)
def _add(first, sums, out):
    for i in range(len(sums)):
        out[first + i] += sums[i]


@njit(**OPTIONS)
def _add_rows_0_1(r, out):
    """Add the products of columns 0 and 1 with themselves and the later ones."""
    s00 = s01 = s02 = s03 = s04 = s05 = s06 = s07 = s08 = ZERO
    s11 = s12 = s13 = s14 = s15 = s16 = s17 = s18 = ZERO
    for i in range(SIDE):
        c0, c1, c2, c3 = r[C0 + i], r[C1 + i], r[C2 + i], r[C3 + i]
        c4, c5, c6 = r[C4 + i], r[C5 + i], r[C6 + i]
        w, e = r[WEIGHT + i], r[ERROR + i]
        w0 = w * c0
        s00 += w0 * c0
        s01 += w0 * c1
        s02 += w0 * c2
        s03 += w0 * c3
        s04 += w0 * c4
        s05 += w0 * c5
        s06 += w0 * c6
        s07 += w0
        s08 += w0 * e
        w1 = w * c1
        s11 += w1 * c1
        s12 += w1 * c2
        s13 += w1 * c3
        s14 += w1 * c4
        s15 += w1 * c5
        s16 += w1 * c6
        s17 += w1
        s18 += w1 * e
    _add(0, (s00, s01, s02, s03, s04, s05, s06, s07, s08, s11, s12, s13, s14, s15, s16, s17, s18), out)


@njit(**OPTIONS)
def _add_rows_2_3(r, out):
    """Add the products of columns 2 and 3."""
    s22 = s23 = s24 = s25 = s26 = s27 = s28 = ZERO
    s33 = s34 = s35 = s36 = s37 = s38 = ZERO
    for i in range(SIDE):
        c2, c3, c4, c5 = r[C2 + i], r[C3 + i], r[C4 + i], r[C5 + i]
        c6 = r[C6 + i]
        w, e = r[WEIGHT + i], r[ERROR + i]
        w2 = w * c2
        s22 += w2 * c2
        s23 += w2 * c3
        s24 += w2 * c4
        s25 += w2 * c5
        s26 += w2 * c6
        s27 += w2
        s28 += w2 * e
        w3 = w * c3
        s33 += w3 * c3
        s34 += w3 * c4
        s35 += w3 * c5
        s36 += w3 * c6
        s37 += w3
        s38 += w3 * e
    _add(17, (s22, s23, s24, s25, s26, s27, s28, s33, s34, s35, s36, s37, s38), out)


@njit(**OPTIONS)
def _add_rows_4_8(r, out):
    """Add the products of columns 4 to 8: the last are one (its weight alone) and the residual."""
    s44 = s45 = s46 = s47 = s48 = s55 = s56 = s57 = s58 = s66 = s67 = s68 = s77 = s78 = s88 = ZERO
    for i in range(SIDE):
        c4, c5, c6 = r[C4 + i], r[C5 + i], r[C6 + i]
        w, e = r[WEIGHT + i], r[ERROR + i]
        w4 = w * c4
        s44 += w4 * c4
        s45 += w4 * c5
        s46 += w4 * c6
        s47 += w4
        s48 += w4 * e
        w5 = w * c5
        s55 += w5 * c5
        s56 += w5 * c6
        s57 += w5
        s58 += w5 * e
        w6 = w * c6
        s66 += w6 * c6
        s67 += w6
        s68 += w6 * e
        we = w * e
        s77 += w
        s78 += we
        s88 += we * e
    _add(30, (s44, s45, s46, s47, s48, s55, s56, s57, s58, s66, s67, s68, s77, s78, s88), out)


@njit(**OPTIONS)
def _count(r, histogram):
    """Add the visible residuals of a block to a histogram (NUM_BINS,)."""
    for i in range(SIDE):
        b = (r[ERROR + i] + np.float32(HALF_RANGE)) * np.float32(BINS_PER_GRAY)
        b = b if b > ZERO else ZERO
        b = b if b < np.float32(NUM_BINS - 1) else np.float32(NUM_BINS - 1)
        histogram[np.uint32(np.int32(b))] += np.int32(r[SEEN + i])


@njit(**OPTIONS)
def histogram_median_and_mad(histogram):
    """Median and median absolute deviation of a residual histogram (NUM_BINS,) i32, and the number counted.

    Linear within a bin, so both are exact to a small part of 1 / BINS_PER_GREY (M15 eq. 12, 35).
    """
    below = np.zeros(NUM_BINS + 1)
    for i in range(NUM_BINS):
        below[i + 1] = below[i] + histogram[i]
    total = below[NUM_BINS]
    if total == 0:
        return 0.0, 0.0, 0.0
    half, b = total / 2.0, 0
    while below[b + 1] < half:
        b += 1
    middle = b + (half - below[b]) / histogram[b]
    low, high = 0.0, float(NUM_BINS)
    for _ in range(30):  # bisection on the half width that holds half of all
        width = 0.5 * (low + high)
        if _counted_below(below, middle + width) - _counted_below(below, middle - width) < half:
            low = width
        else:
            high = width
    return middle / BINS_PER_GRAY - HALF_RANGE, high / BINS_PER_GRAY, total


@njit(**OPTIONS)
def _counted_below(below, position):
    if position <= 0:
        return 0.0
    if position >= NUM_BINS:
        return below[NUM_BINS]
    b = int(position)
    return below[b] + (position - b) * (below[b + 1] - below[b])


@njit(**OPTIONS)
def scale(blocks, step, T, camera, image, gain, bias, r, places, histogram):
    """Median, MAD and number of the visible residuals of each `step`-th block."""
    histogram[:] = 0
    for b in range(0, blocks.size // BLOCK, step):
        d = blocks[b * BLOCK : (b + 1) * BLOCK]
        locate(T, camera, image, d, r, places)
        compare(gain, bias, d, r)
        _count(r, histogram)
    return histogram_median_and_mad(histogram)


@njit(**OPTIONS)
def _correlate(d, r, correlation):
    """Add what the correlation of reference and warped image needs."""
    sum_r = sum_c = product = square_r = square_c = ZERO
    for i in range(SIDE):
        seen, current, gray = r[SEEN + i], r[C6 + i], d[GRAY + i]
        sum_r += seen * gray
        sum_c += seen * current
        product += seen * gray * current
        square_r += seen * gray * gray
        square_c += seen * current * current
    _add(0, (sum_r, sum_c, product, square_r, square_c), correlation)


@njit(**OPTIONS)
def accumulate(blocks, first, last, T, camera, image, gain, bias, median, width, r, places, sums, correlation):
    """Add the products of the weighted columns of blocks first..last to sums (NUM_SUMS,) f64.

    T (3, 4) f32 reference -> camera; `median` and `width`, the Huber bound a sigma, in grey levels. The columns are
    by (v, omega) of the reference, gain and bias; the ninth is the residual. To correlation (5,) f64 the sums of
    reference, image, their product and both squares, of grey levels as they are, light not applied.
    """
    for b in range(first, last):
        d = blocks[b * BLOCK : (b + 1) * BLOCK]
        locate(T, camera, image, d, r, places)
        _differentiate(T, gain, bias, d, r)
        sums[INLIERS] += _weigh(median, width, d, r)
        _add_rows_0_1(r, sums)
        _add_rows_2_3(r, sums)
        _add_rows_4_8(r, sums)
        visible = ZERO
        for i in range(SIDE):
            visible += r[SEEN + i]
        sums[VISIBLE] += visible
        _correlate(d, r, correlation)


@njit(**OPTIONS)
def locate_all(blocks, T, camera, image, out):
    """Write the scratch of every block once it is located to out (B, SCRATCH) f32."""
    places = np.empty(SIDE, np.int32)
    for b in range(out.shape[0]):
        locate(T, camera, image, blocks[b * BLOCK : (b + 1) * BLOCK], out[b], places)
