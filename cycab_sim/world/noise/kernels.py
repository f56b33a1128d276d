"""Hashed noise and patterns, each filtered by the footprint of the ray; no state, no tables.

A pattern never sees a pixel grid: it gets a point in the frame of its surface (u along, v up, w out, metres) and
the ellipse that the cone of the ray cuts out of it, and returns the mean over that ellipse, exactly for edges and
pulses, by damped octaves for noise. So two cameras at different distances agree up to their resolution.
`foot` is (minor, major, bu, bv, fu, fv): lengths of the axes, direction of the long axis, extent along u and v.
"""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import njit

STEP_I, STEP_J, STEP_K, STEP_SEED = 0x1B873593, 0x2545F491, 0x19660D3B, 0x3C6EF35F
I_32, J_32, SEED_32, MIX = np.uint32(STEP_I), np.uint32(STEP_J), np.uint32(STEP_SEED), np.uint32(0x2C1B3C6D)
UNIT = np.float32(1.0 / 32768.0)
WINDOW = 1.3  # an octave whose cells are narrower than the footprint / WINDOW has vanished
MAX_TAPS = 3
MAX_OCTAVES = 12
COS, SIN = 0.79863551, 0.60181502  # every octave is turned by 37 degrees against the one before


@njit(cache=True)
def _mix(h):
    """Scramble a lattice code of 32 bits to 16."""
    h = np.uint32(np.uint32(h ^ np.uint32(h >> np.uint32(15))) * MIX)
    h = np.uint32(h ^ np.uint32(h >> np.uint32(16)))
    return np.float32(np.int32(h & np.uint32(0xFFFF)))


@njit(cache=True)
def hashed(i, j, k, seed):
    """Return a number in [-1, 1) for a lattice cell."""
    return UNIT * _mix(np.uint32((i * STEP_I) ^ (j * STEP_J) ^ (k * STEP_K) ^ (seed * STEP_SEED))) - 1.0


@njit(cache=True)
def _layer(x, y, code):
    """Blend the four 16-bit values around a point of the plane of `code`, in the precision of the point.

    Codes are 32 bits wide, so that the compiler can take eight points of 32 bits at a time.
    """
    two, three = np.float32(2.0), np.float32(3.0)
    left, low = np.floor(x), np.floor(y)
    s, t = x - left, y - low
    s, t = s * s * (three - two * s), t * t * (three - two * t)
    i, j = np.uint32(np.uint32(np.int32(left)) * I_32), np.uint32(np.uint32(np.int32(low)) * J_32)
    right, high = np.uint32(i + I_32), np.uint32(np.uint32(j + J_32) ^ code)
    j = np.uint32(j ^ code)
    a, c = _mix(np.uint32(i ^ j)), _mix(np.uint32(i ^ high))
    below = a + s * (_mix(np.uint32(right ^ j)) - a)
    above = c + s * (_mix(np.uint32(right ^ high)) - c)
    return below + t * (above - below)


@njit(cache=True)
def noise2(x, y, seed):
    """Value noise in [-1, 1] on the plane, cell size 1."""
    return UNIT * _layer(x, y, np.uint32(seed * STEP_SEED)) - 1.0


@njit(cache=True)
def noise3(x, y, z, seed):
    """Value noise in [-1, 1] in space, cell size 1."""
    near, code = math.floor(z), seed * STEP_SEED
    r, k = z - near, int(near) * STEP_K
    r = r * r * (3.0 - 2.0 * r)
    below, above = _layer(x, y, np.uint32(k ^ code)), _layer(x, y, np.uint32((k + STEP_K) ^ code))
    return UNIT * (below * (1.0 - r) + above * r) - 1.0


@njit(cache=True)
def fbm2(u, v, foot, size, gain, octaves, seed):
    """Sum octaves of cell `size`, size / 2, ...; gain 1 gives every octave the same contrast, as in natural images.

    Octaves finer than the footprint vanish; across a long ellipse up to MAX_TAPS samples along it are averaged.
    """
    minor, major, bu, bv = foot[0], foot[1], foot[2], foot[3]
    total, amplitude, scale = 0.0, 1.0, 1.0 / size
    for octave in range(octaves):
        taps = min(MAX_TAPS, 1 + int(1.4 * major * scale))
        share = 1.0 / taps
        blur = max(minor, major * share) * scale * (1.0 / WINDOW)
        if blur >= 1.0:
            break
        value, step_u, step_v = 0.0, major * share * scale * bu, major * share * scale * bv
        x, y = u * scale - 0.5 * (taps - 1) * step_u, v * scale - 0.5 * (taps - 1) * step_v
        for _ in range(taps):
            value += share * noise2(x, y, seed + octave)
            x, y = x + step_u, y + step_v
        keep = 1.0 - blur * blur
        total += amplitude * keep * keep * value
        u, v = COS * u - SIN * v, SIN * u + COS * v
        bu, bv = COS * bu - SIN * bv, SIN * bu + COS * bv
        amplitude, scale = amplitude * gain, 2.0 * scale
    return total


@njit(cache=True, nogil=True, fastmath=True)
def sum_octaves(points, seeds, out):
    """Write the sum of octaves at many points at once, out (N,) f32: `fbm2` in a form that fills vector registers.

    points (8, N) f32: u, v, minor, major, bu, bv, 1 / size of the first cells, gain; seeds (N,) u4.
    All values are finite. Always MAX_TAPS samples; octaves end where they have vanished at every point.
    """
    num, third = points.shape[1], np.float32(1.0 / MAX_TAPS)
    cells_of = np.empty((5, num), np.float32)  # u, v, step between samples along u and v, blur; all in first cells
    narrowest = np.float32(1e30)
    for n in range(num):
        step, inverse = third * points[3, n], points[6, n]
        cells_of[0, n], cells_of[1, n] = points[0, n] * inverse, points[1, n] * inverse
        cells_of[2, n], cells_of[3, n] = points[4, n] * step * inverse, points[5, n] * step * inverse
        cells_of[4, n] = max(points[2, n], step) * inverse * np.float32(1.0 / WINDOW)
        narrowest = min(narrowest, cells_of[4, n])
        out[n] = 0.0
    amplitude, gain = np.ones(num, np.float32), points[7]
    c, s, scale = 1.0, 0.0, 1.0
    for octave in range(MAX_OCTAVES):
        if narrowest * scale >= 1.0:
            break
        _add_octave(cells_of, seeds, (c * scale, s * scale, scale), np.uint32(octave), amplitude, out)
        for n in range(num):
            amplitude[n] *= gain[n]
        c, s, scale = COS * c - SIN * s, SIN * c + COS * s, 2.0 * scale


@njit(cache=True, nogil=True, fastmath=True)
def _add_octave(cells_of, seeds, turned, octave, amplitude, out):
    """Add one octave; everything is 32 bits wide."""
    c, s, scale = np.float32(turned[0]), np.float32(turned[1]), np.float32(turned[2])
    one, third = np.float32(1.0), np.float32(1.0 / MAX_TAPS)
    u, v, bu, bv, wide = cells_of[0], cells_of[1], cells_of[2], cells_of[3], cells_of[4]
    for n in range(out.size):
        blur = min(one, wide[n] * scale)
        keep = one - blur * blur
        x, y = c * u[n] - s * v[n], s * u[n] + c * v[n]
        du, dv = c * bu[n] - s * bv[n], s * bu[n] + c * bv[n]
        seed = np.uint32(np.uint32(seeds[n] + octave) * SEED_32)
        total = (UNIT * _layer(x, y, seed) - one) + (UNIT * _layer(x - du, y - dv, seed) - one)
        total += UNIT * _layer(x + du, y + dv, seed) - one
        out[n] += amplitude[n] * keep * keep * third * total


@njit(cache=True)
def fbm3(u, v, w, foot, size, gain, octaves, seed):
    """Sum octaves of noise in space, for surfaces that are not flat."""
    width = math.sqrt(foot[0] * min(foot[1], 4.0 * foot[0]))
    total, amplitude, scale = 0.0, 1.0, 1.0 / size
    for octave in range(octaves):
        blur = width * scale * (1.0 / WINDOW)
        if blur >= 1.0:
            break
        keep = 1.0 - blur * blur
        total += amplitude * keep * keep * noise3(u * scale, v * scale, w * scale, seed + octave)
        u, v = COS * u - SIN * v, SIN * u + COS * v
        v, w = COS * v - SIN * w, SIN * v + COS * w
        amplitude, scale = amplitude * gain, 2.0 * scale
    return total


@njit(cache=True)
def along(matrix, row, v):
    """Return the product of a row of a matrix (R, 3 or more) with a vector (3,)."""
    return matrix[row, 0] * v[0] + matrix[row, 1] * v[1] + matrix[row, 2] * v[2]


@njit(cache=True)
def step(x, width):
    """Share of an interval of `width` around x that is positive."""
    return min(1.0, max(0.0, x / width + 0.5))


@njit(cache=True)
def within(x, low, high, width):
    """Share of an interval around x that lies between two edges."""
    return step(x - low, width) - step(x - high, width)


@njit(cache=True)
def pulse(x, period, duty, width):
    """Share of an interval around x where a periodic pulse is on: the first `duty` of each period."""
    a, b = (x - 0.5 * width) / period, (x + 0.5 * width) / period
    fa, fb = math.floor(a), math.floor(b)
    return ((fb - fa) * duty + min(b - fb, duty) - min(a - fa, duty)) / (b - a)


@njit(cache=True)
def cells(u, v, pu, pv, shift, foot, seed):
    """Random level per cell pu x pv (every second row shifted), blended over the footprint, gone when it is larger."""
    y = v / pv - 0.5
    j = math.floor(y)
    across = step(y - j - 0.5, max(foot[5] / pv, 1e-6))
    total = 0.0
    for dj in range(2):
        row = int(j) + dj
        x = u / pu - 0.5 - shift * (row & 1)
        i = math.floor(x)
        along = step(x - i - 0.5, max(foot[4] / pu, 1e-6))
        a, b = hashed(int(i), row, 7, seed), hashed(int(i) + 1, row, 7, seed)
        total += (a + along * (b - a)) * (across if dj else 1.0 - across)
    ratio = max(foot[4] / pu, foot[5] / pv)
    return total * math.exp(-ratio * ratio)


@njit(cache=True)
def joints(u, v, pu, pv, gap, shift, foot):
    """Share of the footprint that lies on the joints of a bond of pu x pv cells."""
    row = math.floor(v / pv)
    solid = pulse(u - shift * pu * (row & 1) - 0.5 * gap, pu, 1.0 - gap / pu, foot[4])
    return 1.0 - solid * pulse(v - 0.5 * gap, pv, 1.0 - gap / pv, foot[5])


@njit(cache=True)
def line(distance, width, foot):
    """Share of the footprint covered by a line of `width` whose centre is `distance` away."""
    blur = width + foot[0] + 0.5 * foot[1]
    return max(0.0, 1.0 - distance / blur) * width / blur
