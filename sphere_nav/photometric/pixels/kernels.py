"""Kernels beside the iteration: pyramid, reference, saliency, selection, overlap. Plain arrays in and out.

Arrays of points and gradients are (3, N) float32, one row a coordinate. Nothing runs in several threads: an image is
aligned in a few milliseconds by one, and the other cores have work of their own.
"""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit
from sphere_nav.photometric.align.iteration.kernels import (
    BLOCK,
    BX,
    BY,
    BZ,
    GRAY,
    J0,
    J1,
    J2,
    J3,
    J4,
    J5,
    ONE,
    PX,
    PY,
    PZ,
    SCRATCH,
    SEEN,
    SIDE,
    THREE,
    TWO,
    ZERO,
    U,
    V,
    X,
    Y,
    Z,
    project,
    transform,
)

BY_64 = np.float32(1.0 / 64.0)
HALF = np.float32(0.5)


@njit(**OPTIONS)
def halve(image, pad, weights, rounding, out):
    """Next pyramid level (H // 2, W // 2) of an image (H, W): weights 1 3 3 1 over 8 both ways.

    The result is centred between pixels. The border repeats; of a whole sphere both have `pad` columns of the other
    edge. `weights` are 1 and 3, of a type that holds eight grey levels; `rounding` is added to what is written.
    """
    rows, columns = out.shape[0], out.shape[1] - 2 * pad
    height, last = image.shape[0], min(2 * columns + pad, image.shape[1] - 1)
    line, three = np.empty(2 * columns + 2, weights.dtype), weights[1]  # made elsewhere it could be a part of the image
    for v in range(rows):
        a, b, c, d = image[max(2 * v - 1, 0)], image[2 * v], image[2 * v + 1], image[min(2 * v + 2, height - 1)]
        for i, u in ((0, 0), (2 * columns + 1, last)):
            line[i] = a[u] + d[u] + three * (b[u] + c[u])
        a, b, c, d, target = a[pad:], b[pad:], c[pad:], d[pad:], out[v, pad:]
        for u in range(2 * columns):
            line[u + 1] = a[u] + d[u] + three * (b[u] + c[u])
        for u in range(columns):
            outer = np.float32(line[2 * u]) + np.float32(line[2 * u + 3])
            inner = np.float32(line[2 * u + 1]) + np.float32(line[2 * u + 2])
            target[u] = (outer + THREE * inner) * BY_64 + rounding
        if pad:
            out[v, 0], out[v, columns + 1] = target[columns - 1], target[0]


@njit(**OPTIONS)
def halve_range(range_m, ratio, out):
    """Next level of a range image (H, W) f32: the mean inverse range of the nearest surface in each 2 x 2 block.

    Ranges beyond `ratio` times the nearest belong to another surface and are left out, so no point hangs between
    two. NaN only where all four are NaN.
    """
    rows, columns = out.shape
    for v in range(rows):
        a, b, target = range_m[2 * v], range_m[2 * v + 1], out[v]
        for u in range(columns):
            four = (a[2 * u], a[2 * u + 1], b[2 * u], b[2 * u + 1])
            nearest, number = np.float32(np.inf), ZERO
            for r in four:
                if r == r:
                    number += ONE
                    nearest = min(nearest, r)
            inverse, used = ZERO, ZERO
            for r in four:
                if r <= nearest * ratio:
                    inverse += ONE / r
                    used += ONE
            if number == 0:
                target[u] = np.float32(np.nan)
            elif inverse == 0:
                target[u] = np.float32(np.inf)
            else:
                target[u] = used / inverse


STEP = np.float32(1.0 / 256.0)  # of the grey levels that are kept of a reference
BY_STEP = np.float32(256.0)
WHITE = np.float32(255.0)


@njit(**OPTIONS)
def quantize(image, pad, out):
    """Grey levels (H, W) f32 or u8 in steps of `STEP`: out (H, W + 2 pad) u16, a whole sphere with its other edge."""
    height, width = image.shape
    for v in range(height):
        source, target = image[v], out[v]
        for u in range(width):
            target[u + pad] = np.uint16(min(max(np.float32(source[u]), ZERO), WHITE) * BY_STEP + HALF)
        if pad:
            target[0], target[width + 1] = target[width], target[1]


UNKNOWN, FAR = 65535, 65534  # codes of ranges without a length
PER_OCTAVE = 2978  # codes from one power of two to the next: ranges are within 0.017 %
NEAREST = (127 - 8) << 23  # bits of 2^-8 m, below which all is as near; what is beyond 2^14 m is far
HALF_STEP = 1 << 22
RANGES = (NEAREST + (np.arange(FAR + 2) << 23) // PER_OCTAVE).astype(np.int32).view(np.float32)  # m, by their codes
RANGES[FAR], RANGES[UNKNOWN] = np.inf, np.nan


@njit(**OPTIONS)
def encode_range(range_m, out):
    """Codes (H, W) u16 of ranges (H, W) f32, by which they are in `RANGES`: in the order of the ranges, NaN last."""
    bits = range_m.view(np.int32)
    for v in range(range_m.shape[0]):
        source, target = range_m[v], out[v]
        for u in range(range_m.shape[1]):
            code = ((bits[v, u] - NEAREST) * PER_OCTAVE + HALF_STEP) >> 23
            target[u] = min(max(code, 0), FAR) if source[u] == source[u] else UNKNOWN


@njit(**OPTIONS)
def is_edge(before, a, b, after, share, floor):
    """Whether the nearness (1/m) leaps from a to b by more than from `before` to a or b to `after`.

    So it does on no slanted plane and in no corner of a room. What is unknown (NaN) hides no edge.
    """
    sign = np.float32(math.copysign(1.0, b - a))
    usual = ZERO
    for other in (sign * (a - before), sign * (after - b)):
        if other > usual:
            usual = other
    return sign * (b - a) - usual > max(floor, share * max(a, b))


@njit(**OPTIONS)
def forget_behind_edges(range_m, pixels, share, codes):
    """Write `UNKNOWN` into codes (H, W) u16 of ranges (H, W) f32 within so many pixels behind a nearer surface's edge.

    An edge is a leap of the inverse range by a `share` of the nearer one.
    """
    rows, columns = range_m.shape
    unknown, keep = np.float32(np.nan), ONE - share
    for down in range(2):
        right = 1 - down
        for v in range(rows - down):
            for u in range(columns - right):
                a, b = range_m[v, u], range_m[v + down, u + right]
                if a < keep * b or b < keep * a:
                    y, x = v - down, u - right
                    before = range_m[y, x] if y >= 0 and x >= 0 else unknown
                    y, x = v + 2 * down, u + 2 * right
                    after = range_m[y, x] if y < rows and x < columns else unknown
                    if is_edge(ONE / before, ONE / a, ONE / b, ONE / after, share, ZERO):
                        for off in range(pixels):
                            step = -off if b < a else 1 + off
                            y, x = v + step * down, u + step * right
                            codes[min(max(y, 0), rows - 1), min(max(x, 0), columns - 1)] = UNKNOWN


SQUARE = 16  # px: pixels of a reference are kept square by square, `SIDE` of them
NUM_KEYS = 1 << 8  # 32 octaves of |J| in 8 steps each: order within 12 %
LOWEST_KEY = (127 - 12) << 3  # bits of 2^-12; what is smaller is all the same
NUM_SCORES = 1 << 12  # steps of a pixel's place among all
NUM_SAMPLES = 1 << 14  # pixels by which the columns are counted


@njit(**OPTIONS)
def bound_squares(codes, ranges, far, pad, cones, bounds):
    """Write the sphere around the usable points of each square: centre and radius (M, 4) f32; return their number.

    codes (H, W) u16 of ranges `RANGES`, cones (M, 4) f32: axis and half angle of each square's rays. The radius is -1
    where no pixel is usable: without range, in the first or last row or (unpadded) column.
    """
    height, width = codes.shape
    columns, number = -(-width // SQUARE), 0
    for b in range(bounds.shape[0]):
        v0, u0 = b // columns * SQUARE, b % columns * SQUARE
        nearest, farthest, count = UNKNOWN, 0, 0
        for v in range(max(v0, 1), min(v0 + SQUARE, height - 1)):
            for u in range(max(u0, 1 - pad), min(u0 + SQUARE, width - 1 + pad)):
                code = int(codes[v, u])
                if code != UNKNOWN:
                    nearest, farthest = min(nearest, code), max(farthest, code)
                    count += 1
        number += count
        bounds[b, 3] = -ONE
        if count and cones[b, 3] >= ZERO:
            low, high = min(ranges[nearest], far), min(ranges[farthest], far)
            middle, cosine = HALF * (low + high), np.float32(math.cos(cones[b, 3]))
            near = low * low + middle * middle - TWO * low * middle * cosine
            distant = high * high + middle * middle - TWO * high * middle * cosine
            for j in range(3):
                bounds[b, j] = cones[b, j] * middle
            bounds[b, 3] = math.sqrt(max(near, distant)) * np.float32(1.0001)
    return number


@njit(**OPTIONS)
def ray_of(rays, v, u, width):
    """Return the ray of a pixel: from columns, cosine and sine of the azimuth (2, W), and rows (2, H) of a sphere.

    Or from all rays (3, H W) of another camera, both of the others empty.
    """
    columns, rows, table = rays
    if table.shape[1]:
        pixel = v * width + u
        return table[0, pixel], table[1, pixel], table[2, pixel]
    return columns[0, u] * rows[0, v], columns[1, u] * rows[0, v], rows[1, v]


@njit(**OPTIONS)
def fill_squares(squares, first, image, pad, codes, ranges, far, rays, camera, pool, keys):
    """Points, grey levels and gradients by the point (M15 eq. 30, at the reference itself) of squares (K,) i32.

    image (H, W + 2 pad) u16 in steps of `STEP` grey levels, codes (H, W) u16 of ranges `RANGES`, rays as `ray_of`
    takes them, camera the model and coefficients. Writes them at the places `first` and on of pool (S * BLOCK,) f32,
    unusable pixels as what no camera sees, and how much each fixes by every column of J (M15 eq. 14) into keys
    (S * SIDE, 6) u8.
    """
    height, width = codes.shape
    columns = -(-width // SQUARE)
    r, du, dv = np.empty(SCRATCH, np.float32), np.empty(SIDE, np.float32), np.empty(SIDE, np.float32)
    for k in range(squares.size):
        v0, u0 = squares[k] // columns * SQUARE, squares[k] % columns * SQUARE
        d = pool[(first + k) * BLOCK : (first + k + 1) * BLOCK]
        for i in range(SIDE):
            r[X + i], r[Y + i], r[Z + i] = ZERO, ZERO, np.float32(np.nan)
            du[i], dv[i], d[GRAY + i] = ZERO, ZERO, ZERO
        for v in range(max(v0, 1), min(v0 + SQUARE, height - 1)):
            for u in range(max(u0, 1 - pad), min(u0 + SQUARE, width - 1 + pad)):
                code, i, c = codes[v, u], (v - v0) * SQUARE + u - u0, u + pad
                if code != UNKNOWN:
                    distance = min(ranges[code], far)
                    x, y, z = ray_of(rays, v, u, width)
                    r[X + i], r[Y + i], r[Z + i] = x * distance, y * distance, z * distance
                    d[GRAY + i] = STEP * np.float32(image[v, c])
                    du[i] = HALF * STEP * (np.float32(image[v, c + 1]) - np.float32(image[v, c - 1]))
                    dv[i] = HALF * STEP * (np.float32(image[v + 1, c]) - np.float32(image[v - 1, c]))
        for i in range(SIDE):
            d[PX + i], d[PY + i], d[PZ + i] = r[X + i], r[Y + i], r[Z + i]
        project(camera[0], camera[1], r)
        for i in range(SIDE):
            is_known = d[PZ + i] == d[PZ + i]
            d[BX + i] = du[i] * r[J0 + i] + dv[i] * r[J3 + i] if is_known else ZERO
            d[BY + i] = du[i] * r[J1 + i] + dv[i] * r[J4 + i] if is_known else ZERO
            d[BZ + i] = du[i] * r[J2 + i] + dv[i] * r[J5 + i] if is_known else ZERO
        _write_keys(d, keys[(first + k) * SIDE : (first + k + 1) * SIDE])


@njit(**OPTIONS)
def _write_keys(d, keys):
    """Write the upper bits of |J^j| of a block into keys (SIDE, 6) u8: larger ones fix more."""
    value = np.empty(SIDE, np.float32)
    bits = value.view(np.int32)
    for j in range(6):
        a, b = (j + 1) % 3 * SIDE, (j + 2) % 3 * SIDE
        for i in range(SIDE):
            if j < 3:
                value[i] = d[BX + j * SIDE + i]
            else:
                value[i] = d[PX + a + i] * d[BX + b + i] - d[PX + b + i] * d[BX + a + i]
        for i in range(SIDE):
            keys[i, j] = min(max(((bits[i] & 0x7FFFFFFF) >> 20) - LOWEST_KEY, 0), NUM_KEYS - 1)


@njit(**OPTIONS)
def _may_be_seen(T, bound, cone):
    """Say whether a sphere reaches into the cone (axis and half angle) of a camera."""
    x = T[0, 0] * bound[0] + T[0, 1] * bound[1] + T[0, 2] * bound[2] + T[0, 3]
    y = T[1, 0] * bound[0] + T[1, 1] * bound[1] + T[1, 2] * bound[2] + T[1, 3]
    z = T[2, 0] * bound[0] + T[2, 1] * bound[1] + T[2, 2] * bound[2] + T[2, 3]
    distance = math.sqrt(x * x + y * y + z * z)
    if distance <= bound[3]:
        return True
    cosine = (x * cone[0] + y * cone[1] + z * cone[2]) / distance
    limit = cone[3] + math.asin(bound[3] / distance)
    return limit >= math.pi or cosine >= math.cos(limit)


@njit(**OPTIONS)
def find_squares(bounds, order, T, cone, found):
    """Write the squares that may reach into the cone of a camera into found (M,) i32, in an order; return how many."""
    count = 0
    for b in order:
        if bounds[b, 3] >= ZERO and _may_be_seen(T, bounds[b], cone):
            found[count] = b
            count += 1
    return count


@njit(**OPTIONS)
def find_visible(places, pool, T, camera, width, height, seen):
    """Write the pixels of the squares at places (K,) i32 that project into the image into seen (K * SIDE,) i32.

    A pixel is named by its place, `SIDE` of them a square. Return how many.
    """
    count = 0
    last_u, last_v = np.float32(width - 1), np.float32(height - 1)
    r = np.empty(SCRATCH, np.float32)
    for k in range(places.size):
        transform(T, pool[places[k] * BLOCK : (places[k] + 1) * BLOCK], r)
        project(camera[0], camera[1], r)
        first = places[k] * SIDE
        for i in range(SIDE):
            u, v = r[U + i], r[V + i]
            inside = (r[SEEN + i] > ZERO) & (u >= ZERO) & (u <= last_u) & (v >= ZERO) & (v <= last_v)
            seen[count] = first + i
            count += 1 if inside else 0
    return count


@njit(**OPTIONS)
def _score_keys(seen, keys, scores):
    """Write into scores (6, NUM_KEYS) i32 at which share of all seen pixels a column has one with a key."""
    step = max(1, seen.size // NUM_SAMPLES)
    counts = np.zeros((6, NUM_KEYS), np.int32)
    total = 0
    for k in range(0, seen.size, step):
        total += 1
        for j in range(6):
            counts[j, keys[seen[k], j]] += 1
    for j in range(6):
        before = 0
        for key in range(NUM_KEYS - 1, -1, -1):
            scores[j, key] = (2 * before + counts[j, key]) * (NUM_SCORES - 1) // (2 * total)
            before += counts[j, key]


@njit(**OPTIONS)
def best_of(seen, keys, number):
    """Return `number` of the seen pixels (N,) i32: of each of the six columns the best as far down as there is room.

    The run-time selection of M15 eq. 16 by the order of its algorithm 1, a counting sort of what is visible. Pixels
    keep their order; of those that are alike at the limit, some all over the image.
    """
    place = np.empty((6, NUM_KEYS), np.int32)
    _score_keys(seen, keys, place)
    score, counts = np.empty(seen.size, np.int16), np.zeros(NUM_SCORES, np.int32)
    for k in range(seen.size):
        i = seen[k]
        first = min(place[0, keys[i, 0]], place[1, keys[i, 1]], place[2, keys[i, 2]])
        second = min(place[3, keys[i, 3]], place[4, keys[i, 4]], place[5, keys[i, 5]])
        score[k] = min(first, second)
        counts[score[k]] += 1
    limit, below = 0, 0
    while below + counts[limit] < number:
        below += counts[limit]
        limit += 1
    alike, room, passed, kept = counts[limit], number - below, 0, 0
    best = np.empty(number, np.int32)
    for k in range(seen.size):
        is_kept = score[k] < limit
        if score[k] == limit:
            is_kept = (passed + 1) * room // alike > passed * room // alike
            passed += 1
        if is_kept:
            best[kept] = seen[k]
            kept += 1
    return best


@njit(**OPTIONS)
def gather(pool, chosen, blocks):
    """Copy the chosen pixels (N,) i32 from pool into blocks; return their mean inverse range, 1 without any.

    The last block is filled up with points that no camera sees.
    """
    number, inverse = chosen.size, 0.0
    for kept in range(number):
        at, i = (kept // SIDE) * BLOCK + kept % SIDE, (chosen[kept] // SIDE) * BLOCK + chosen[kept] % SIDE
        for row in range(0, BLOCK, SIDE):
            blocks[at + row] = pool[i + row]
        x, y, z = blocks[at + PX], blocks[at + PY], blocks[at + PZ]
        inverse += ONE / math.sqrt(x * x + y * y + z * z)
    for kept in range(number, blocks.size // BLOCK * SIDE):
        at = (kept // SIDE) * BLOCK + kept % SIDE
        for row in range(0, BLOCK, SIDE):
            blocks[at + row] = ZERO
        blocks[at + PZ] = np.float32(np.nan)
    return inverse / number if number else 1.0


@njit(**OPTIONS)
def cover(places, pool, T, camera, width, height, side, covered):
    """Mark the cells (`side` pixels wide) of an image that pixels of squares at places (K,) i32 fall into.

    covered (rows, columns) bool.
    """
    low, right, bottom = -HALF, np.float32(width) - HALF, np.float32(height) - HALF
    r = np.empty(SCRATCH, np.float32)
    for k in range(places.size):
        transform(T, pool[places[k] * BLOCK : (places[k] + 1) * BLOCK], r)
        project(camera[0], camera[1], r)
        for i in range(SIDE):
            u, v = r[U + i], r[V + i]
            if r[SEEN + i] > ZERO and u >= low and u < right and v >= low and v < bottom:
                covered[int(v + HALF) // side, int(u + HALF) // side] = True
