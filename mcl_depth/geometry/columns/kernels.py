"""The inner loops of the columns: planes of voxels, gaps between them, and the walk outwards. Plain arrays in and out.

A voxel is a row (8,) f4: mean x, y, z, lowest and highest z, unit normal (zero where its points are no plane).
"""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit, prange

INLINE = OPTIONS | {"inline": "always"}  # a call hands over each array in seven words

BLOCK_BITS = 4  # a block is 2^4 x 2^4 columns
BLOCK = 1 << BLOCK_BITS
CELLS = BLOCK * BLOCK
NUM_SEARCH = 2048  # bins of the table that leads from a slope to a row
NEAR = np.float32(1e-3)  # m, where a walk begins
STEEP = np.float32(1e-6)
FEW = 4  # voxels of a column that are tried one by one
SQUARINGS = 6  # of a matrix: its largest eigenvalue to the power of 64

_half = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
DIRECTIONS = np.array([*_half, (1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)], np.int64)  # one of every pair


# ---- building ---------------------------------------------------------------------------------------------------


@njit(**INLINE)
def _place(i, j):
    """Return the place of a cell in its block: patches of 4 x 4 cells lie together, in one line of the cache."""
    return (i & 12) << 4 | (j & 12) << 2 | (i & 3) << 2 | (j & 3)


@njit(**OPTIONS)
def _column(blocks, starts, i, j):
    """Return first and end voxel of the column over cell (i, j); blocks (X, Y) i4, starts (B * CELLS + 1,) i4."""
    x, y = i >> BLOCK_BITS, j >> BLOCK_BITS
    if i < 0 or j < 0 or x >= blocks.shape[0] or y >= blocks.shape[1] or blocks[x, y] < 0:
        return 0, 0
    cell = blocks[x, y] * CELLS + _place(i, j)
    return starts[cell], starts[cell + 1]


@njit(**OPTIONS)
def _first_from(cells, first, end, k):
    """Return the first voxel of a column whose height index is at least k; cells (V, 3) i4."""
    while first < end:
        middle = (first + end) >> 1
        if cells[middle, 2] < k:
            first = middle + 1
        else:
            end = middle
    return first


@njit(**OPTIONS)
def _strongest(xx, xy, xz, yy, yz, zz):
    """Return the eigenvector of the largest eigenvalue of a symmetric matrix (not negative), and that eigenvalue."""
    a, b, c, d, e, f = xx, xy, xz, yy, yz, zz
    for _ in range(SQUARINGS):
        trace = a + d + f
        if not trace > 0.0:
            return 0.0, 0.0, 0.0, 0.0
        by = 1.0 / trace
        a, b, c, d, e, f = a * by, b * by, c * by, d * by, e * by, f * by
        a, b, c, d, e, f = (
            a * a + b * b + c * c, a * b + b * d + c * e, a * c + b * e + c * f,
            b * b + d * d + e * e, b * c + d * e + e * f, c * c + e * e + f * f,
        )  # fmt: skip
    if a >= d and a >= f:
        x, y, z = a, b, c
    elif d >= f:
        x, y, z = b, d, e
    else:
        x, y, z = c, e, f
    by = 1.0 / math.sqrt(x * x + y * y + z * z)
    x, y, z = x * by, y * by, z * by
    value = x * (xx * x + xy * y + xz * z) + y * (xy * x + yy * y + yz * z) + z * (xz * x + yz * y + zz * z)
    return x, y, z, value


@njit(**OPTIONS)
def _scatter(v, means, cells, blocks, starts):
    """Return the covariance of the means in the 3 x 3 x 3 cells around voxel v, xx xy xz yy yz zz, and their number."""
    sx, sy, sz, n = 0.0, 0.0, 0.0, 0
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for di in range(-1, 2):
        for dj in range(-1, 2):
            first, end = _column(blocks, starts, cells[v, 0] + di, cells[v, 1] + dj)
            w = _first_from(cells, first, end, cells[v, 2] - 1)
            while w < end and cells[w, 2] <= cells[v, 2] + 1:
                x, y, z = means[w, 0] - means[v, 0], means[w, 1] - means[v, 1], means[w, 2] - means[v, 2]
                n, sx, sy, sz = n + 1, sx + x, sy + y, sz + z
                xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
                yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
                w += 1
    by = 1.0 / n
    sx, sy, sz = sx * by, sy * by, sz * by
    return (
        xx * by - sx * sx, xy * by - sx * sy, xz * by - sx * sz,
        yy * by - sy * sy, yz * by - sy * sz, zz * by - sz * sz, n,
    )  # fmt: skip


@njit(parallel=True, **OPTIONS)
def fit_planes(means, cells, blocks, starts, size):
    """Return normals (V, 3) of the neighbourhoods (3 x 3 x 3) of voxels, zero where flat they are not, and is_dense.

    means (V, 3) f8 in m, cells (V, 3) i4. is_dense (V,): the neighbours are a surface or more, not a line or a point.
    """
    normals, is_dense = np.zeros((len(means), 3)), np.zeros(len(means), np.bool_)
    for v in prange(len(means)):
        xx, xy, xz, yy, yz, zz, n = _scatter(v, means, cells, blocks, starts)
        trace = xx + yy + zz
        if n < 4 or not trace > 0.0:
            continue
        _, _, _, largest = _strongest(xx, xy, xz, yy, yz, zz)
        over = 1.0001 * trace  # turns the order of the eigenvalues round
        x, y, z, rest = _strongest(over - xx, -xy, -xz, over - yy, -yz, over - zz)
        smallest = over - rest
        middle = trace - largest - smallest
        is_dense[v] = middle > (0.3 * size) ** 2
        if is_dense[v] and smallest < 0.15 * middle:
            normals[v, 0], normals[v, 1], normals[v, 2] = x, y, z
    return normals, is_dense


@njit(parallel=True, **OPTIONS)
def find_gaps(means, normals, cells, blocks, starts, size, tolerance):
    """Return (V, 13) i4: the voxel two steps away in each direction, where the one between is missing; else -1.

    Only where both lie in one plane, to `tolerance` of the size of a voxel.
    """
    far = np.full((len(means), len(DIRECTIONS)), -1, np.int32)
    limit = tolerance * size
    for v in prange(len(means)):
        if normals[v, 0] == 0.0 and normals[v, 1] == 0.0 and normals[v, 2] == 0.0:
            continue
        for d in range(len(DIRECTIONS)):
            i, j, k = cells[v, 0] + DIRECTIONS[d, 0], cells[v, 1] + DIRECTIONS[d, 1], cells[v, 2] + DIRECTIONS[d, 2]
            first, end = _column(blocks, starts, i, j)
            between = _first_from(cells, first, end, k)
            if between < end and cells[between, 2] == k:
                continue
            k += DIRECTIONS[d, 2]
            first, end = _column(blocks, starts, i + DIRECTIONS[d, 0], j + DIRECTIONS[d, 1])
            w = _first_from(cells, first, end, k)
            if w >= end or cells[w, 2] != k:
                continue
            way = means[w] - means[v]
            off = abs(normals[v, 0] * way[0] + normals[v, 1] * way[1] + normals[v, 2] * way[2])
            other = abs(normals[w, 0] * way[0] + normals[w, 1] * way[1] + normals[w, 2] * way[2])
            if off < limit and other < limit:
                far[v, d] = w
    return far


@njit(parallel=True, **OPTIONS)
def join_planes(moments, min_share):
    """Return normals (V, 3) of sums of their outer products (V, 6), xx xy xz yy yz zz; zero where they differ."""
    normals = np.zeros((len(moments), 3))
    for v in prange(len(moments)):
        xx, xy, xz, yy, yz, zz = moments[v]
        x, y, z, value = _strongest(xx, xy, xz, yy, yz, zz)
        if value > 0.0 and value >= min_share * (xx + yy + zz):
            normals[v, 0], normals[v, 1], normals[v, 2] = x, y, z
    return normals


# ---- drawing ----------------------------------------------------------------------------------------------------


@njit(**INLINE)
def _meet(voxel, t0, t1, x, y, z, c, s, slope):
    """Return the horizontal distance in t0 to t1 at which a ray of a slope meets a voxel seen from x, y, z."""
    mx, my, mz = voxel[0] - x, voxel[1] - y, voxel[2] - z
    dn = voxel[5] * c + voxel[6] * s + voxel[7] * slope
    t = (voxel[5] * mx + voxel[6] * my + voxel[7] * mz) / dn if abs(dn) > STEEP else mx * c + my * s
    return min(max(t, t0), t1)


@njit(**INLINE)
def _last_below(voxels, first, end, z):
    """Return the end of the voxels first:end whose lowest z is at most z; they rise."""
    while first < end:
        middle = (first + end) >> 1
        if voxels[middle, 3] <= z:
            first = middle + 1
        else:
            end = middle
    return first


@njit(**INLINE)
def _draw_cell(voxels, first, end, t0, t1, x, y, z, c, s, slopes, rises, search, reach, span, column):
    """Fill what the voxels first:end of a cell, which a ray crosses from t0 to t1 (m), hide of a column (H,).

    span (2,) i8: the highest and the lowest row that are not filled yet.
    """
    by_near, by_far = np.float32(1.0) / t0, np.float32(1.0) / t1
    limit = slopes[span[0]] * (t1 if slopes[span[0]] > 0 else t0) + z
    if end - first > FEW and voxels[end - 1, 3] > limit:
        end = _last_below(voxels, first, end, limit)
    for w in range(end - 1, first - 1, -1):
        high, low = voxels[w, 4] - z, voxels[w, 3] - z
        steepest = high * (by_near if high > 0 else by_far)
        if steepest < slopes[span[1]]:
            return
        flattest = low * (by_far if low > 0 else by_near)
        if flattest > slopes[span[0]]:
            continue
        bin_ = int((steepest / (np.float32(1.0) + abs(steepest)) + np.float32(1.0)) * np.float32(NUM_SEARCH / 2))
        row = max(search[min(bin_, NUM_SEARCH - 1)], span[0])
        while row <= span[1] and slopes[row] > steepest:
            row += 1
        is_changed = False
        while row <= span[1] and slopes[row] >= flattest:
            if math.isnan(column[row]):
                r = _meet(voxels[w], t0, t1, x, y, z, c, s, slopes[row]) * rises[row]
                if reach[0] <= r <= reach[1]:
                    column[row] = r
                    is_changed = True
            row += 1
        if is_changed:
            while span[0] <= span[1] and not math.isnan(column[span[0]]):
                span[0] += 1
            while span[1] >= span[0] and not math.isnan(column[span[1]]):
                span[1] -= 1
            if span[1] < span[0]:
                return


@njit(**OPTIONS)
def _walk_level(
    voxels,
    blocks,
    starts,
    tops,
    shape,
    size,
    from_t,
    to_t,
    x,
    y,
    z,
    c,
    s,
    slopes,
    rises,
    search,
    reach,
    top,
    span,
    column,
):
    """Walk along one azimuth (c, s) through the grid of one level between two distances in m.

    blocks (X * Y,) i4, starts and tops of this level, shape (2,) i8 = X, Y; top: highest z of the map.
    """
    by_size = np.float32(1.0) / size
    gx, gy = (x + c * from_t) * by_size, (y + s * from_t) * by_size
    i, j = math.floor(gx), math.floor(gy)
    step_i, step_j = (1 if c > 0 else -1), (1 if s > 0 else -1)
    per_i = size / abs(c) if abs(c) > STEEP else np.float32(1e9)
    per_j = size / abs(s) if abs(s) > STEEP else np.float32(1e9)
    next_i = from_t + per_i * (np.float32(i + 1) - gx if c > 0 else gx - np.float32(i))
    next_j = from_t + per_j * (np.float32(j + 1) - gy if s > 0 else gy - np.float32(j))
    t0 = from_t
    last_x, last_y, block = -1, -1, -1
    while t0 < to_t:
        t1 = min(next_i, next_j, to_t)
        bx, by = i >> BLOCK_BITS, j >> BLOCK_BITS
        if bx != last_x or by != last_y:
            last_x, last_y = bx, by
            is_inside = 0 <= bx < shape[0] and 0 <= by < shape[1]
            block = blocks[bx * shape[1] + by] if is_inside else -1
            if slopes[span[1]] * t0 > top - z:
                span[1] = span[0] - 1  # nothing of the map is as high as what is still open
                return
        if block >= 0:
            cell = block * CELLS + _place(i, j)
            high = tops[cell] - z
            near, far = max(t0, NEAR), max(t1, NEAR)
            if high >= slopes[span[1]] * (near if high > 0 else far):  # false for an empty cell, too
                _draw_cell(
                    voxels, starts[cell], starts[cell + 1], near, far, x, y, z, c, s,
                    slopes, rises, search, reach, span, column,
                )  # fmt: skip
                if span[1] < span[0]:
                    return
        t0 = t1
        if next_i < next_j:
            i += step_i
            next_i += per_i
        else:
            j += step_j
            next_j += per_j


@njit(**OPTIONS)
def _clipped(x, y, c, s, width, depth, max_t):
    """Return between which distances in m a ray is over the map, 0 to width and 0 to depth m."""
    low, high = np.float32(0.0), max_t
    for p, d, w in ((x, c, width), (y, s, depth)):
        if abs(d) > STEEP:
            a, b = -p / d, (w - p) / d
            low, high = max(low, min(a, b)), min(high, max(a, b))
        elif p < 0 or p > w:
            high = np.float32(-1.0)
    return low, high


@njit(**OPTIONS)
def _draw(
    place, voxels, blocks, starts, tops, levels, sizes, extent, azimuths, slopes, rises, search, pixel, reach, out
):
    """Draw what one place (3,) f4, from the corner of the map, sees into out (H, W)."""
    H, W = out.shape
    column, span = np.empty(H, np.float32), np.empty(2, np.int64)
    x, y, z = place
    for u in range(W):
        c, s = azimuths[u, 0], azimuths[u, 1]
        column[:] = np.float32(np.nan)
        span[0], span[1] = 0, H - 1
        begin, stop = _clipped(x, y, c, s, extent[0], extent[1], reach[1])
        for level in range(len(sizes)):
            from_t = np.float32(0.0) if level == 0 else sizes[level] / pixel
            to_t = stop if level + 1 == len(sizes) else sizes[level + 1] / pixel
            from_t, to_t = max(from_t, begin), min(to_t, stop)
            if from_t < to_t and span[0] <= span[1]:
                a, b = levels[level, 0], levels[level, 1]
                _walk_level(
                    voxels, blocks[a:], starts[b:], tops[b:], levels[level, 2:], sizes[level], from_t, to_t,
                    x, y, z, c, s, slopes, rises, search, reach, extent[2], span, column,
                )  # fmt: skip
        for v in range(H):
            out[v, u] = column[v]


@njit(parallel=True, **OPTIONS)
def draw_columns(
    places, voxels, blocks, starts, tops, levels, sizes, extent, azimuths, slopes, rises, search, pixel, reach, out
):
    """Draw M places (M, 3) f4, each in one thread, into out (M, H, W) f4: ranges in m, NaN where nothing is met.

    voxels (V, 8) f4, blocks (B,) i4, starts (S,) i4 and tops (S,) f4, the highest z of a column (NaN: none), of all
    levels one after the other; levels (L, 4) i8: where blocks and starts of a level begin, blocks along x and y;
    sizes (L,) f4 of their cells in m; extent (3,) f4 of the map in m; azimuths (W, 2) f4: cosine and sine; slopes (H,)
    f4 falling: tangents of the elevations; rises (H,) f4: range by horizontal distance; search (NUM_SEARCH,) i8: a row
    not below that of a slope; pixel: rad; reach (2,) f4 in m.
    """
    for i in prange(len(places)):
        _draw(
            places[i], voxels, blocks, starts, tops, levels, sizes, extent,
            azimuths, slopes, rises, search, pixel, reach, out[i],
        )  # fmt: skip
    return out
