"""Loops of the sweep on the sphere, and costs of matches. Plain arrays in and out; the callers check shapes.

Loops over columns or hypotheses have no branches and one index each, so that they become vectors.
"""

from __future__ import annotations

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit

SCALE = 8  # levels of images are eighths of a grey level
NUM_HYPOTHESES = 64  # of inverse range: a constant, so that the loops over them become vectors
COST_CAP = 120  # eighths of a grey level that the difference of two cameras counts up to
UNSEEN = -20000  # level of a pixel without use; nothing that is seen comes near it
NO_LEVEL = -10000  # below it a level, interpolated, is unseen
RUN_UP = 32  # px around the seam, by which a smoothed path has forgotten where it began
WALL = 12000  # cost beside the first and the last hypothesis
NUM_TERMS = 7  # of a step: whether cameras see, degrees of freedom, g g, g e, e e, px by x squared, gradient squared
NUM_SUMS = 10  # over cameras: 1, I, I I, G, G G, G I, du, dv, du^2 + dv^2, squared gradient
INDEPENDENT = (
    1.69  # squared 1.3: errors of neighbors are not independent, beside the deviation that the residual alone gives
)
NUM_DISPARITIES = 48  # searched at each level along columns
DISPARITY_CAP = 200  # quarter grey levels: the largest difference of two pixels that counts there
COST_NOISE = 4  # quarter grey levels: added to every such difference, so that noise decides nothing
CHUNK = 128  # columns that are worked on at a time, so that what is between stays in the cache


@njit(**OPTIONS)
def _sample_hypotheses(rows, column, step, image, size, unseen, out):
    """Write what one camera shows at one column and all hypotheses to out (K,) i16; `unseen` where it shows nothing.

    rows (gw, 2, K) f32: pixels at every step-th column; image: levels, row by row; size (2,): rows, columns.
    """
    g, f = column // step, np.float32(column % step) / np.float32(step)
    left, right, stride = rows[g], rows[g + 1], np.int32(size[1])
    zero, no_level = np.float32(0.0), np.float32(NO_LEVEL)
    last_x, last_y = np.float32(size[1] - 2), np.float32(size[0] - 2)
    at = np.empty(NUM_HYPOTHESES, np.int32)
    x, y = np.empty(NUM_HYPOTHESES, np.float32), np.empty(NUM_HYPOTHESES, np.float32)
    for k in range(NUM_HYPOTHESES):
        u = min(max(left[0, k] + f * (right[0, k] - left[0, k]), zero), last_x)
        v = min(max(left[1, k] + f * (right[1, k] - left[1, k]), zero), last_y)
        i, j = np.int32(u), np.int32(v)
        x[k], y[k], at[k] = u - np.float32(i), v - np.float32(j), j * stride + i
    for k in range(NUM_HYPOTHESES):
        i = at[k]
        p0, p1 = np.float32(image[i]), np.float32(image[i + 1])
        p2, p3 = np.float32(image[i + stride]), np.float32(image[i + stride + 1])
        top, low = p0 + x[k] * (p1 - p0), p2 + x[k] * (p3 - p2)
        value = top + y[k] * (low - top)
        out[k] = np.int16(value) if value > no_level else unseen


@njit(**OPTIONS)
def _add_differences(a, b, total):
    """Add how much two cameras (K,) i16 differ to total, alike."""
    cap = np.int16(COST_CAP)
    for k in range(NUM_HYPOTHESES):
        off = np.int16(a[k] - b[k])
        total[k] += min(off if off >= 0 else np.int16(-off), cap)


@njit(**OPTIONS)
def sweep(table, step, images, starts, sizes, cameras, numbers, first, last, cost):
    """Write the mean difference of all pairs of cameras that see a direction to rows of cost (H, W, K) u8.

    table (gh, C, gw, 2, K) f32: pixels of the cameras in every step-th direction and at all hypotheses; images: levels
    less their mean around, i16, of all cameras one after the other, from starts (C,) on, of sizes (C, 2): rows and
    columns; cameras (H, W, N) i8, numbers (H, W) i8: which ones see, and how many; first, last: rows.
    """
    width, most = cameras.shape[1:]
    rows = np.empty(table.shape[1:], np.float32)
    seen, total = np.zeros((most, NUM_HYPOTHESES), np.int16), np.zeros(NUM_HYPOTHESES, np.int16)
    for v in range(first, last):
        f = np.float32(v % step) / np.float32(step)
        above, below, between = table[v // step].ravel(), table[v // step + 1].ravel(), rows.ravel()
        for i in range(between.size):
            between[i] = above[i] + f * (below[i] - above[i])
        for u in range(width):
            number = numbers[v, u]
            if number < 2:
                cost[v, u, :] = COST_CAP
                continue
            for n in range(number):
                c = cameras[v, u, n]
                unseen = np.int16(UNSEEN - 1000 * n)  # no two that see nothing are alike
                _sample_hypotheses(rows[c], u, step, images[starts[c] :], sizes[c], unseen, seen[n])
            total[:] = 0
            for n in range(number):
                for m in range(n):
                    _add_differences(seen[n], seen[m], total)
            share = np.float32(1.0) / np.float32(number * (number - 1) // 2)
            for k in range(NUM_HYPOTHESES):
                cost[v, u, k] = np.uint8(np.float32(total[k]) * share)


@njit(**OPTIONS)
def compare_levels(top, low, high, cost):
    """Write how far levels are outside of what they are compared with, up to DISPARITY_CAP, to cost (W, H, K) u8.

    top (W, H) i16: columns one after the other. low, high (W, H + K - 1) i16: the least and largest level of the lower
    image half a pixel up and down, alike, from the lowest row upwards; row v at the k-th disparity is at H - 1 - v + k.
    """
    width, height, number = cost.shape
    zero, cap = np.int16(0), np.int16(DISPARITY_CAP)
    for u in range(width):
        for v in range(height):
            seen, level, out = slice(height - 1 - v, height - 1 - v + number), top[u, v], cost[u, v]
            least, largest = low[u, seen], high[u, seen]
            for k in range(number):
                off = max(max(np.int16(level - largest[k]), np.int16(least[k] - level)), zero)
                out[k] = np.uint8(min(off, cap))


@njit(**OPTIONS)
def sum_blocks(cost, radius, out):
    """Write sums over (2 radius + 1)^2 px of cost (H, W, K) u8 to out (H - 2 radius, W - 2 radius, K) i16."""
    height, width, number = cost.shape
    size = 2 * radius + 1
    sums, total = np.zeros((width, number), np.int16), np.zeros(number, np.int16)
    nothing, none = np.zeros(number, np.uint8), np.zeros(number, np.int16)
    for v in range(height):
        for u in range(width):
            fresh, gone, column = cost[v, u], cost[v - size, u] if v >= size else nothing, sums[u]
            for k in range(number):
                column[k] += np.int16(np.int16(fresh[k]) - np.int16(gone[k]))
        total[:] = 0
        for u in range(width if v >= 2 * radius else 0):
            column, left = sums[u], sums[u - size] if u >= size else none
            for k in range(number):
                total[k] += np.int16(column[k] - left[k])
            if u >= 2 * radius:
                out[v - 2 * radius, u - 2 * radius] = total


@njit(**OPTIONS)
def _least_costs(block, at):
    """Return the least of block (K,) i16 within one of `at`, and the least of those not within two."""
    big = np.int16(32767)
    here = elsewhere = big
    for k in range(block.size):
        off = abs(k - at)
        here = min(here, block[k] if off <= 1 else big)
        elsewhere = min(elsewhere, block[k] if off > 2 else big)
    return np.float32(here), np.float32(elsewhere)


@njit(**OPTIONS)
def cost_ratios(block, disparity, first, floor, ratio):
    """Write the least cost of a block elsewhere over that at a disparity to ratio (W, H); NaN unknown.

    block (W, H, K) i16: costs at disparities from `first` on; disparity, ratio (W, H) f32. `floor` is added to both.
    """
    width, height, number = block.shape
    for u in range(width):
        for v in range(height):
            d = disparity[u, v]
            ratio[u, v] = np.nan
            if not np.isnan(d):
                at = min(max(int(np.floor(d + np.float32(0.5))) - first, 0), number - 1)
                here, elsewhere = _least_costs(block[u, v], at)
                ratio[u, v] = (elsewhere + floor) / (here + floor)


@njit(**OPTIONS)
def _go_on(cost, before, least, p1, p2, after, total):
    """Go on by one pixel along a path: before, after (K + 2,) i16 with walls at the ends; return the least of after."""
    low, middle, high = before[:NUM_HYPOTHESES], before[1 : NUM_HYPOTHESES + 1], before[2 : NUM_HYPOTHESES + 2]
    jump, out = np.int16(least + p2), after[1 : NUM_HYPOTHESES + 1]
    smallest = np.int16(32767)
    for k in range(NUM_HYPOTHESES):
        value = np.int16(cost[k] + min(min(middle[k], np.int16(min(low[k], high[k]) + p1)), jump) - least)
        out[k] = value
        total[k] += value
        smallest = value if value < smallest else smallest
    return smallest


@njit(**OPTIONS)
def sum_paths(cost, p1, p2, total):
    """Add the costs of eight smoothed paths (Hirschmueller 2008) of cost (H, W, K) i16 to total, alike, zeros.

    p1, p2: of a step to the next hypothesis, and to any other one. Columns wrap around.
    """
    height, width = cost.shape[:2]
    wall = np.int16(WALL)
    for turn in range(2):
        rows = np.full((2, 3, width, NUM_HYPOTHESES + 2), wall, np.int16)
        least = np.zeros((2, 3, width), np.int16)
        line = np.full((2, NUM_HYPOTHESES + 2), wall, np.int16)
        spare = np.zeros(NUM_HYPOTHESES, np.int16)
        for i in range(height):
            v, now, was = (i if turn == 0 else height - 1 - i), i % 2, 1 - i % 2
            line[:, 1 : NUM_HYPOTHESES + 1] = 0
            smallest = np.int16(0)
            for j in range(-RUN_UP, width):
                u = (j if turn == 0 else width - 1 - j) % width
                into = total[v, u] if j >= 0 else spare
                spare[:] = 0
                smallest = _go_on(cost[v, u], line[1 - j % 2], smallest, p1, p2, line[j % 2], into)
            for d in range(3):
                for u in range(width):
                    if i == 0:
                        rows[now, d, u, 1 : NUM_HYPOTHESES + 1] = cost[v, u]
                        for k in range(NUM_HYPOTHESES):
                            total[v, u, k] += cost[v, u, k]
                        least[now, d, u] = cost[v, u].min()
                    else:
                        s = (u + d - 1) % width
                        into, own = total[v, u], rows[now, d, u]
                        least[now, d, u] = _go_on(cost[v, u], rows[was, d, s], least[was, d, s], p1, p2, own, into)


@njit(**OPTIONS)
def choose(total, block, floor, min_ratio, found):
    """Write the hypothesis (H, W) f32 of the least smoothed cost, between whole ones; NaN where it is not clearly best.

    total, block (H, W, K) i16: smoothed costs, and those of a pixel's own block. The block's least cost beyond two
    hypotheses must be min_ratio times the one here, `floor` added to both. The first hypothesis stands for all that is
    beyond.
    """
    height, width = found.shape
    for v in range(height):
        for u in range(width):
            costs, own = total[v, u], block[v, u]
            best, least = 0, costs[0]
            for k in range(1, NUM_HYPOTHESES):
                if costs[k] < least:
                    best, least = k, costs[k]
            here, elsewhere = _least_costs(own, best)
            found[v, u] = np.nan
            if elsewhere + floor >= min_ratio * (here + floor) and best < NUM_HYPOTHESES - 2:
                found[v, u] = best
                if best > 0:
                    before, after = np.float32(costs[best - 1]), np.float32(costs[best + 1])
                    bend = before + after - np.float32(2.0) * np.float32(least)
                    found[v, u] += np.float32(0.5) * (before - after) / max(bend, np.float32(1.0))


@njit(**OPTIONS)
def _place(x, azimuths, elevation, R, b, extent, side, at, fu, fv, ds, dt, ok):
    """Write where rays are in the table of a camera's lens, and how that changes with inverse range.

    x (n,) f32 inverse range, NaN unknown; azimuths (2, n), elevation (2,): sine and cosine; R (3, 3), b (3,): p = R ray
    - x b is the point in the frame of the camera, by its range. The table has side x side entries over p_x and p_y by
    |p| + p_z, the tangents of half the angle off the axis; extent (2,): largest one, entries by tangent. at (n,) i32;
    fu, fv (fractions), ds, dt (slopes), ok (1 where there is such an entry) (n,) f32.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    largest, per_tangent, z, level = extent[0], extent[1], elevation[0], elevation[1]
    last, stride = np.float32(side - 2), np.int32(side)
    bx, by, bz = b[0], b[1], b[2]
    for i in range(x.size):
        is_known = x[i] == x[i]
        w = x[i] if is_known else zero
        dx, dy = level * azimuths[1, i], level * azimuths[0, i]
        px = R[0, 0] * dx + R[0, 1] * dy + R[0, 2] * z - w * bx
        py = R[1, 0] * dx + R[1, 1] * dy + R[1, 2] * z - w * by
        pz = R[2, 0] * dx + R[2, 1] * dy + R[2, 2] * z - w * bz
        distance = np.sqrt(px * px + py * py + pz * pz)
        share = one / max(distance + pz, np.float32(1e-3))
        s, t = px * share, py * share
        change = -(px * bx + py * by + pz * bz) / max(distance, np.float32(1e-6)) - bz
        u, v = (s + largest) * per_tangent, (t + largest) * per_tangent
        is_in = is_known & (u >= zero) & (v >= zero) & (u < last) & (v < last)
        u, v = (u if is_in else zero), (v if is_in else zero)
        i0, j0 = np.int32(u), np.int32(v)
        at[i], fu[i], fv[i] = j0 * stride + i0, u - np.float32(i0), v - np.float32(j0)
        ds[i], dt[i] = (-bx - s * change) * share * per_tangent, (-by - t * change) * share * per_tangent
        ok[i] = one if is_in else zero


@njit(**OPTIONS)
def _bend(n, table, side, at, fu, fv, ds, dt, scale, u, v, du, dv):
    """Write the pixels u, v (n,) f32 of a camera for places in its table (S S, 2) f32, and their slopes."""
    for i in range(n):
        k = at[i]
        a, b, c, d = table[k, 0], table[k + 1, 0], table[k + side, 0], table[k + side + 1, 0]
        right, down, twist = b - a, c - a, d - c - b + a
        u[i] = (a + fu[i] * right + fv[i] * (down + fu[i] * twist)) * scale
        du[i] = ((right + fv[i] * twist) * ds[i] + (down + fu[i] * twist) * dt[i]) * scale
        a, b, c, d = table[k, 1], table[k + 1, 1], table[k + side, 1], table[k + side + 1, 1]
        right, down, twist = b - a, c - a, d - c - b + a
        v[i] = (a + fu[i] * right + fv[i] * (down + fu[i] * twist)) * scale
        dv[i] = ((right + fv[i] * twist) * ds[i] + (down + fu[i] * twist) * dt[i]) * scale


@njit(**OPTIONS)
def _look(n, image, size, u, v, du, dv, ok, sums, own):
    """Sample a camera at n pixels u, v; add to sums (NUM_SUMS, n), write 1 (0: not seen), I and G to own (3, n)."""
    one, zero, no_level = np.float32(1.0), np.float32(0.0), np.float32(NO_LEVEL)
    stride, last_u, last_v = np.int32(size[1]), np.float32(size[1] - 2), np.float32(size[0] - 2)
    for i in range(n):
        is_in = (u[i] >= zero) & (v[i] >= zero) & (u[i] < last_u) & (v[i] < last_v) & (ok[i] > zero)
        x, y = (u[i] if is_in else zero), (v[i] if is_in else zero)
        i0, j0 = np.int32(x), np.int32(y)
        fx, fy = x - np.float32(i0), y - np.float32(j0)
        k = j0 * stride + i0
        p0, p1 = np.float32(image[k]), np.float32(image[k + 1])
        p2, p3 = np.float32(image[k + stride]), np.float32(image[k + stride + 1])
        right, down, twist = p1 - p0, p2 - p0, p3 - p2 - p1 + p0
        value = p0 + fx * right + fy * (down + fx * twist)
        m = one if is_in & (value > no_level) else zero
        gx, gy = (right + fy * twist) * m, (down + fx * twist) * m
        slope = gx * du[i] + gy * dv[i]
        value *= m
        a, b = du[i] * m, dv[i] * m
        own[0, i], own[1, i], own[2, i] = m, value, slope
        sums[0, i] += m
        sums[1, i] += value
        sums[2, i] += value * value
        sums[3, i] += slope
        sums[4, i] += slope * slope
        sums[5, i] += slope * value
        sums[6, i] += a
        sums[7, i] += b
        sums[8, i] += a * a + b * b
        sums[9, i] += gx * gx + gy * gy


@njit(**OPTIONS)
def _close(sums, own, terms):
    """Write the terms (NUM_TERMS + 2 C, W) of a row from the sums over its cameras, all beside their means.

    own (C, 3, W): of each camera; the last 2 C terms are its level and its slope beside the mean of all.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    width = sums.shape[1]
    for u in range(width):
        m = sums[0, u]
        n, share = (one if m > np.float32(1.5) else zero), one / max(m, one)
        terms[0, u] = n
        terms[1, u] = (m - one) * n
        terms[2, u] = (sums[4, u] - sums[3, u] * sums[3, u] * share) * n
        terms[3, u] = (sums[5, u] - sums[3, u] * sums[1, u] * share) * n
        terms[4, u] = (sums[2, u] - sums[1, u] * sums[1, u] * share) * n
        terms[5, u] = (sums[8, u] - (sums[6, u] * sums[6, u] + sums[7, u] * sums[7, u]) * share) * n
        terms[6, u] = sums[9, u] * share * n
        sums[1, u] *= share
        sums[3, u] *= share
    for c in range(len(own)):
        seen, level, slope = own[c]
        for u in range(width):
            m = seen[u] * terms[0, u]
            terms[NUM_TERMS + 2 * c, u] = (level[u] - sums[1, u]) * m
            terms[NUM_TERMS + 2 * c + 1, u] = (slope[u] - sums[3, u]) * m


@njit(**OPTIONS)
def _sum_along(row, radius, out):
    """Write sums of 2 radius + 1 neighbours of row (W,) f32 to out, alike; columns wrap around."""
    width = row.size
    for u in range(width):
        out[u] = row[u]
    for d in range(1, radius + 1):
        for u in range(width - d):
            out[u] += row[u + d]
        for u in range(width - d):
            out[u + d] += row[u]
        for u in range(d):
            out[width - d + u] += row[u]
            out[u] += row[width - d + u]


@njit(**OPTIONS)
def _settle(sums, before, start, limits, out, std, left, unlike):
    """Move a row (W,) f32 to where its blocks are most probable; see `align`."""
    limit_px, least, noise, prior_px, max_px, calibration, dependent, misaligned = limits
    zero, one, nan, tiny = np.float32(0.0), np.float32(1.0), np.float32(np.nan), np.float32(1e-9)
    factor = np.float32(INDEPENDENT)
    for c in range(NUM_TERMS, len(sums), 2):  # exposures of cameras are never quite equal
        level, slope = sums[c], sums[c + 1]
        for u in range(out.size):
            share = one / max(sums[0, u], one)
            sums[2, u] -= slope[u] * slope[u] * share
            sums[3, u] -= slope[u] * level[u] * share
            sums[4, u] -= level[u] * level[u] * share
    for u in range(out.size):
        n, x = sums[0, u], before[u]
        is_known = (x == x) & (n >= least)
        share = one / max(n, one)
        freedom, gg = max(sums[1, u] * share, tiny), max(sums[2, u] * share, tiny)
        ge, ee = sums[3, u] * share, sums[4, u] * share
        per_px = np.sqrt(max(2 * sums[5, u] * share, np.float32(1e-6)))
        seen, prior = gg / noise * n, (per_px / prior_px) ** 2
        move = (-ge / noise * n + prior * (start[u] - x)) / (seen + prior)
        move = min(max(move, -limit_px / per_px), limit_px / per_px)
        residual = max(ee - ge * ge / gg, zero) / freedom
        new = x + move
        out[u] = new if is_known else nan
        per_square = gg / (freedom * per_px * per_px)
        left[u] = residual / (noise + per_square) if is_known else np.float32(np.inf)
        unlike[u] = residual / (noise + misaligned * per_square) if is_known else np.float32(np.inf)
        excess = max(residual - noise, zero)
        variance = (noise * factor / n + excess * (factor / n + dependent)) / gg
        # calibration leaves as much across as along the search: on a line nearly along it, this becomes range
        variance += np.float32(0.5) * calibration * calibration * max(sums[6, u] * share / gg, one / (per_px * per_px))
        std[u] = np.sqrt(variance) if is_known & (abs(new - start[u]) * per_px <= max_px) else nan


@njit(**OPTIONS)
def _compare_row(x, v, directions, images, lens, runs, spare, at, sums, own):
    """Sum what the cameras of `runs` (N, 3) i32 (camera, first column, beyond the last one) show along row v.

    x (W,) f32; directions, images, lens: of `align`; spare (9, CHUNK) f32 and at (CHUNK,) i32 hold what is between;
    sums (NUM_SUMS, W), own (C, 3, W): of `_look`.
    """
    azimuths, elevations = directions
    levels, starts, sizes, scales = images
    rotations, centers, extents, tables = lens
    side = np.int32(np.sqrt(np.float32(tables.shape[1])) + np.float32(0.5))
    fu, fv, ds, dt, ok, pu, pv, du, dv = spare
    for n in range(len(runs)):
        c, end = runs[n, 0], runs[n, 2]
        for a in range(runs[n, 1], end, CHUNK):
            e, is_known = min(a + CHUNK, end), False
            for i in range(a, e):
                is_known |= x[i] == x[i]
            if not is_known:
                continue
            _place(
                x[a:e], azimuths[:, a:e], elevations[:, v], rotations[c], centers[c], extents[c], side,
                at, fu, fv, ds, dt, ok,
            )  # fmt: skip
            _bend(e - a, tables[c], side, at, fu, fv, ds, dt, scales[c], pu, pv, du, dv)
            _look(e - a, levels[starts[c] :], sizes[c], pu, pv, du, dv, ok, sums[:, a:e], own[c, :, a:e])


@njit(**OPTIONS)
def align(x, start, directions, images, lens, runs, first_runs, radius, every, limits, rows, out, std, left, unlike):
    """Do one Gauss-Newton step of inverse range of every block of (2 radius + 1)^2 px over all cameras that see it.

    x, start (H, W) f32: inverse range 1/m, NaN unknown, and where it may be from the coarser level. directions: sine
    and cosine of azimuths (2, W) and elevations (2, H). images: levels of all cameras one after the other, starts (C,),
    sizes (C, 2), scales (C,) f32: this level's pixels by those of the tables. lens: rotations (C, 3, 3), centers (C, 3)
    in the frame of the camera, extents (C, 2), tables (C, S S, 2) f32: see `_place`. runs (N, 3) i32, first_runs
    (H + 1,) i32: which columns of a row a camera sees. Every `every`-th row is sampled. limits (8,) f32: largest step
    in px; least samples of a block; variance of a level; standard deviation of the start in px; largest way from it in
    px; standard deviation in px that calibration leaves; share of what is left that all pixels of a block have in
    common; squared misalignment in px that `unlike` allows. rows (2,): first, beyond the last. out, std, left, unlike
    (H, W) f32: moved x, its deviation, the squared misalignment in px that would explain what is left, and what the
    cameras differ by over what noise and a small misalignment explain.

    With levels I_c and slopes g_c = dI_c / dx, less their means over the cameras c and, of each camera, over the block,
    the step minimizes the sum over block and cameras of (I_c + g_c dx)^2 / noise.
    """
    height, width = x.shape
    size = 2 * radius + 1
    number = NUM_TERMS + 2 * len(images[1])
    ring, sums = np.zeros((size, number, width), np.float32), np.zeros((number, width), np.float32)
    wide, over = np.zeros((number, width), np.float32), np.zeros((NUM_SUMS, width), np.float32)
    own = np.zeros((len(images[1]), 3, width), np.float32)
    spare, at = np.zeros((9, CHUNK), np.float32), np.zeros(CHUNK, np.int32)
    for v in range(rows[0] - radius, rows[1] + radius):
        slot = ring[v % size]
        if v >= 0 and v < height and v % every == 0:
            over[:], own[:, 0] = 0, 0
            seen = runs[first_runs[v] : first_runs[v + 1]]
            _compare_row(x[v], v, directions, images, lens, seen, spare, at, over, own)
            _close(over, own, slot)
        else:
            slot[:] = 0
        o = v - radius
        if o >= rows[0]:
            sums[:] = 0
            for j in range(size):
                total, row = sums.ravel(), ring[j].ravel()
                for i in range(total.size):
                    total[i] += row[i]
            for k in range(number):
                _sum_along(sums[k], radius, wide[k])
            _settle(wide, x[o], start[o], limits, out[o], std[o], left[o], unlike[o])
