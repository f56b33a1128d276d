"""Kernels beside the iteration: pyramid, reference, saliency, selection, overlap. Plain arrays in and out.

Arrays of points and gradients are (3, N) float32, one row a coordinate. Nothing runs in several threads: an image is
aligned in a few milliseconds by one, and the other cores have work of their own.
"""

import math

import numpy as np

from kernel_cache.kernels import OPTIONS, njit
from photometric.iteration.kernels import (
    BLOCK,
    BX,
    BY,
    BZ,
    GREY,
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
def halve_bytes(image, out):
    """Next pyramid level (H // 2, W // 2) f32 of an image (H, W) u8: weights 1 3 3 1 over 8 both ways.

    The result is centred between pixels. The border repeats; a whole sphere is padded by its caller.
    """
    rows, columns = out.shape
    height, last = image.shape[0], min(2 * columns, image.shape[1] - 1)
    line = np.empty(2 * columns + 2, np.uint16)
    for v in range(rows):
        a, b, c, d = image[max(2 * v - 1, 0)], image[2 * v], image[2 * v + 1], image[min(2 * v + 2, height - 1)]
        for u in range(2 * columns):
            line[u + 1] = np.uint16(a[u]) + np.uint16(d[u]) + np.uint16(3) * (np.uint16(b[u]) + np.uint16(c[u]))
        line[0] = line[1]
        line[2 * columns + 1] = np.uint16(a[last]) + d[last] + np.uint16(3) * (np.uint16(b[last]) + c[last])
        target = out[v]
        for u in range(columns):
            outer = np.float32(line[2 * u]) + np.float32(line[2 * u + 3])
            inner = np.float32(line[2 * u + 1]) + np.float32(line[2 * u + 2])
            target[u] = (outer + THREE * inner) * BY_64


@njit(**OPTIONS)
def halve(image, out):
    """`halve_bytes` of an image (H, W) f32."""
    rows, columns = out.shape
    height, last = image.shape[0], min(2 * columns, image.shape[1] - 1)
    line = np.empty(2 * columns + 2, np.float32)
    for v in range(rows):
        a, b, c, d = image[max(2 * v - 1, 0)], image[2 * v], image[2 * v + 1], image[min(2 * v + 2, height - 1)]
        for u in range(2 * columns):
            line[u + 1] = (a[u] + d[u]) + THREE * (b[u] + c[u])
        line[0] = line[1]
        line[2 * columns + 1] = (a[last] + d[last]) + THREE * (b[last] + c[last])
        target = out[v]
        for u in range(columns):
            target[u] = ((line[2 * u] + line[2 * u + 3]) + THREE * (line[2 * u + 1] + line[2 * u + 2])) * BY_64


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


@njit(**OPTIONS)
def reference_points(index, rays, range_m, far, image, pad, camera, points, intensity, gradient):
    """Points, grey levels and gradients by the point (M15 eq. 30, at the reference itself) of chosen pixels.

    index (N,) i64 into the flat image, no pixel of the first or last row or (unpadded) column; rays (3, H W) f32;
    range_m (H W,) f32; image (H, W + 2 pad) f32. Writes points, gradient (3, N) f32, intensity (N,) f32.
    """
    width = image.shape[1] - 2 * pad
    r, du, dv = np.empty(SCRATCH, np.float32), np.empty(SIDE, np.float32), np.empty(SIDE, np.float32)
    for a in range(0, index.shape[0], SIDE):
        n = min(SIDE, index.shape[0] - a)
        r[Z : Z + SIDE] = np.float32(np.nan)
        for i in range(n):
            pixel = index[a + i]
            v, u = pixel // width, pixel % width + pad
            distance = min(range_m[pixel], far)
            r[X + i], r[Y + i] = rays[0, pixel] * distance, rays[1, pixel] * distance
            r[Z + i] = rays[2, pixel] * distance
            intensity[a + i] = image[v, u]
            du[i], dv[i] = HALF * (image[v, u + 1] - image[v, u - 1]), HALF * (image[v + 1, u] - image[v - 1, u])
        for i in range(n):
            points[0, a + i], points[1, a + i], points[2, a + i] = r[X + i], r[Y + i], r[Z + i]
        project(camera[0], camera[1], r)
        for i in range(n):
            gradient[0, a + i] = du[i] * r[J0 + i] + dv[i] * r[J3 + i]
            gradient[1, a + i] = du[i] * r[J1 + i] + dv[i] * r[J4 + i]
            gradient[2, a + i] = du[i] * r[J2 + i] + dv[i] * r[J5 + i]


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


@njit(**OPTIONS)
def sort_columns(points, gradient, keys, order):
    """Sort the pixels by each of the six steepest-descent columns |J^j| (M15 eq. 14), largest first.

    keys (6, N) u16 scratch; writes order (6, L) u32, the first L <= N of each. Columns are in order to within 0.8 %,
    equal keys in order of the pixels.
    """
    for j in range(6):
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


RANK_BITS = 9  # ranks are counted by 512, then one by one where the limit falls


@njit(**OPTIONS)
def bound_blocks(points, bounds):
    """Write the sphere around each block of points (3, N): centre and radius (M, 4) f32, M = ceil(N / SIDE)."""
    n = points.shape[1]
    for b in range(bounds.shape[0]):
        first, last = b * SIDE, min((b + 1) * SIDE, n)
        for j in range(3):
            low = high = points[j, first]
            for i in range(first, last):
                low, high = min(low, points[j, i]), max(high, points[j, i])
            bounds[b, j] = HALF * (low + high)
        radius2 = ZERO
        for i in range(first, last):
            x, y, z = points[0, i] - bounds[b, 0], points[1, i] - bounds[b, 1], points[2, i] - bounds[b, 2]
            radius2 = max(radius2, x * x + y * y + z * z)
        bounds[b, 3] = math.sqrt(radius2)


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
def find_visible(points, bounds, T, camera, cone, width, height, seen):
    """Write the indices of the points (3, N) that project into the image into seen (N,) i32; return how many."""
    n, count = points.shape[1], 0
    last_u, last_v = np.float32(width - 1), np.float32(height - 1)
    d, r = np.empty(BLOCK, np.float32), np.empty(SCRATCH, np.float32)
    for b in range(bounds.shape[0]):
        if not _may_be_seen(T, bounds[b], cone):
            continue
        first = b * SIDE
        number = min(SIDE, n - first)
        d[PZ : PZ + SIDE] = np.float32(np.nan)
        for j in range(3):
            for i in range(number):
                d[j * SIDE + i] = points[j, first + i]
        transform(T, d, r)
        project(camera[0], camera[1], r)
        for i in range(number):
            u, v = r[U + i], r[V + i]
            inside = (r[SEEN + i] > ZERO) & (u >= ZERO) & (u <= last_u) & (v >= ZERO) & (v <= last_v)
            seen[count] = first + i
            count += 1 if inside else 0
    return count


@njit(**OPTIONS)
def best_of(seen, rank, number):
    """Return the `number` seen pixels (N,) i32 of the best rank (M15 eq. 16), in their order."""
    counts = np.zeros((rank.size >> RANK_BITS) + 1, np.int32)
    for i in seen:
        counts[rank[i] >> RANK_BITS] += 1
    below, b = 0, 0
    while below + counts[b] < number:
        below += counts[b]
        b += 1
    is_here = np.zeros(1 << RANK_BITS, np.uint8)
    for i in seen:
        if rank[i] >> RANK_BITS == b:
            is_here[rank[i] & ((1 << RANK_BITS) - 1)] = 1
    limit = b << RANK_BITS
    while below < number:
        below += is_here[limit & ((1 << RANK_BITS) - 1)]
        limit += 1
    best, kept = np.empty(number, np.int32), 0
    for i in seen:
        if rank[i] < limit:
            best[kept] = i
            kept += 1
    return best


@njit(**OPTIONS)
def fill_blocks(points, intensity, gradient, chosen, blocks):
    """Put the chosen pixels into blocks; return their mean inverse range, 1 without any.

    The last block is filled up with points that no camera sees.
    """
    number, inverse = chosen.size, 0.0
    for kept in range(number):
        at, i = (kept // SIDE) * BLOCK + kept % SIDE, chosen[kept]
        x, y, z = points[0, i], points[1, i], points[2, i]
        blocks[at + PX], blocks[at + PY], blocks[at + PZ], blocks[at + GREY] = x, y, z, intensity[i]
        blocks[at + BX], blocks[at + BY], blocks[at + BZ] = gradient[0, i], gradient[1, i], gradient[2, i]
        inverse += ONE / math.sqrt(x * x + y * y + z * z)
    for kept in range(number, blocks.size // BLOCK * SIDE):
        at = (kept // SIDE) * BLOCK + kept % SIDE
        for row in range(BLOCK // SIDE):
            blocks[at + row * SIDE] = ZERO
        blocks[at + PZ] = np.float32(np.nan)
    return inverse / number if number else 1.0


@njit(**OPTIONS)
def cover(points, bounds, T, camera, cone, width, height, side, covered):
    """Mark the cells (`side` pixels wide) of an image that points (3, N) fall into: covered (rows, columns) bool."""
    n = points.shape[1]
    low, right, bottom = -HALF, np.float32(width) - HALF, np.float32(height) - HALF
    d, r = np.empty(BLOCK, np.float32), np.empty(SCRATCH, np.float32)
    for b in range(bounds.shape[0]):
        if not _may_be_seen(T, bounds[b], cone):
            continue
        first = b * SIDE
        number = min(SIDE, n - first)
        d[PZ : PZ + SIDE] = np.float32(np.nan)
        for j in range(3):
            for i in range(number):
                d[j * SIDE + i] = points[j, first + i]
        transform(T, d, r)
        project(camera[0], camera[1], r)
        for i in range(number):
            u, v = r[U + i], r[V + i]
            if r[SEEN + i] > ZERO and u >= low and u < right and v >= low and v < bottom:
                covered[int(v + HALF) // side, int(u + HALF) // side] = True
