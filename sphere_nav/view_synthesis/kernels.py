"""Kernels of view synthesis: a sphere cut into pieces of surface, these drawn with a z-buffer.

Nearness is the inverse of the range in 1/m: nearly linear across a plane, zero for the sky; NaN or 0 in a drawing:
nothing. Pixels of a sphere are vertices; a *quad* has four of them as corners and may hold many between them.
"""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit
from sphere_nav.photometric.align.iteration.kernels import (
    BLOCK,
    PX,
    PY,
    PZ,
    SCRATCH,
    SEEN,
    SIDE,
    U,
    V,
    X,
    Y,
    Z,
    project,
    transform,
)
from sphere_nav.photometric.pixels.kernels import is_edge

FAR_NEARNESS = np.float32(1e-6)  # 1/m, of what is so far that no motion moves it
EDGE = np.float32(1e-4)  # of a triangle: pixels that lie on the edge of two belong to both
MIN_AREA = np.float32(1e-6)  # px^2, twice the area of a triangle
MAX_SPAN = 512  # px, of a quad in the drawing: wider ones touch the camera
ZERO, ONE, HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)


@njit(**OPTIONS)
def _ends(line, i, wraps, share, floor):
    """Say whether the surface ends behind pixel i of a row or column of nearness (N,)."""
    last = line.size - 1
    if i == last and not wraps:
        return False
    before, after = line[i - 1] if wraps or i > 0 else line[i], line[i + 1] if i < last else line[0]
    beyond = line[i + 2] if i + 2 <= last else (line[i + 1 - last] if wraps else after)
    return is_edge(before, line[i], after, beyond, share, floor)


@njit(**OPTIONS)
def find_breaks(nearness, wraps, share, floor, breaks):
    """Mark in breaks (H, W) u8 where the surface ends to the right (1) and below (2) of a pixel of nearness (H, W)."""
    for v in range(nearness.shape[0]):
        for u in range(nearness.shape[1]):
            right, below = _ends(nearness[v], u, wraps, share, floor), _ends(nearness[:, u], v, False, share, floor)
            breaks[v, u] = (1 if right else 0) + (2 if below else 0)


@njit(**OPTIONS)
def _is_whole(nearness, breaks, v0, u0, size, share, floor):
    """Say whether a block of size x size quads is one plane in nearness, without a break or an unknown pixel."""
    width = nearness.shape[1]
    u1 = (u0 + size) % width
    a, b = nearness[v0, u0], nearness[v0, u1]
    c, d = nearness[v0 + size, u0], nearness[v0 + size, u1]
    by_size = ONE / np.float32(size)
    for i in range(size + 1):
        down = np.float32(i) * by_size
        left, right = a + down * (c - a), b + down * (d - b)
        for j in range(size + 1):
            u = (u0 + j) % width
            here = nearness[v0 + i, u]
            expected = left + np.float32(j) * by_size * (right - left)
            if not abs(here - expected) <= max(floor, share * here):
                return False
            if (j < size and breaks[v0 + i, u] & 1) or (i < size and breaks[v0 + i, u] & 2):
                return False
    return True


@njit(**OPTIONS)
def cut_quads(nearness, breaks, wraps, largest, share, floor, quads):
    """Write the quads (v, u, size) i32 of a sphere to quads (H W, 3), large ones where it is flat; return how many."""
    height, width = nearness.shape
    columns = width if wraps else width - 1
    stack, count = np.empty((64, 3), np.int32), 0
    for first_v in range(0, height - 1, largest):
        for first_u in range(0, columns, largest):
            stack[0, 0], stack[0, 1], stack[0, 2] = first_v, first_u, largest
            waiting = 1
            while waiting:
                waiting -= 1
                v, u, size = stack[waiting, 0], stack[waiting, 1], stack[waiting, 2]
                if v >= height - 1 or u >= columns:
                    continue
                fits = v + size < height and u + size <= columns
                if fits and _is_whole(nearness, breaks, v, u, size, share, floor):
                    quads[count, 0], quads[count, 1], quads[count, 2] = v, u, size
                    count += 1
                elif size > 1:
                    half = size // 2
                    for i in range(4):
                        stack[waiting, 0], stack[waiting, 1] = v + (i // 2) * half, u + (i % 2) * half
                        stack[waiting, 2] = half
                        waiting += 1
    return count


@njit(**OPTIONS)
def project_corners(points, T, camera, placed):
    """Project points (3, N) f32 m into an image: placed (N, 3) = u, v, nearness to the camera; NaN where not seen."""
    number = points.shape[1]
    d, r, nothing = np.empty(BLOCK, np.float32), np.empty(SCRATCH, np.float32), np.float32(np.nan)
    for first in range(0, number, SIDE):
        here = min(SIDE, number - first)
        for i in range(SIDE):
            k = first + i if i < here else first
            d[PX + i], d[PY + i], d[PZ + i] = points[0, k], points[1, k], points[2, k]
        transform(T, d, r)
        for i in range(SIDE):  # rows X, Y, Z are the projection's to overwrite
            d[PX + i] = r[X + i] * r[X + i] + r[Y + i] * r[Y + i] + r[Z + i] * r[Z + i]
        project(camera[0], camera[1], r)
        for i in range(here):
            seen = r[SEEN + i] > ZERO and d[PX + i] > ZERO
            placed[first + i, 0] = r[U + i] if seen else nothing
            placed[first + i, 1] = r[V + i] if seen else nothing
            placed[first + i, 2] = ONE / np.float32(math.sqrt(d[PX + i])) if seen else nothing


@njit(**OPTIONS)
def _draw(quad, second, wraps, nearness, source):
    """Draw a triangle seen from its front, corner 0 of a quad (4, 5), corner `second` and the next one.

    A corner is u, v in the drawing, nearness, and the place (u, v) in the sphere's image times nearness.
    """
    height, width = nearness.shape
    (x0, y0, q0, u0, v0), (x1, y1, q1, u1, v1), (x2, y2, q2, u2, v2) = quad[0], quad[second], quad[second + 1]
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if not area > MIN_AREA:  # seen from behind, or not at all
        return
    first_row, last_row = max(math.ceil(min(y0, y1, y2)), 0), min(math.floor(max(y0, y1, y2)), height - 1)
    first, last = math.ceil(min(x0, x1, x2)), math.floor(max(x0, x1, x2))
    if not wraps:
        first, last = max(first, 0), min(last, width - 1)
    b_x, b_y, c_x, c_y = (y2 - y0) / area, (x0 - x2) / area, (y0 - y1) / area, (x1 - x0) / area
    for row in range(first_row, last_row + 1):
        dy = np.float32(row) - y0
        for column in range(first, last + 1):
            dx = np.float32(column) - x0
            b, c = b_x * dx + b_y * dy, c_x * dx + c_y * dy
            a = ONE - b - c
            here = a * q0 + b * q1 + c * q2
            at = column % width if wraps else column
            if min(a, b, c) >= -EDGE and here > nearness[row, at]:
                nearness[row, at] = here
                source[row, at, 0] = (a * u0 + b * u1 + c * u2) / here
                source[row, at, 1] = (a * v0 + b * v1 + c * v2) / here


@njit(**OPTIONS)
def draw_quads(corners, placed, pixels, sphere_width, wraps, nearness, source):
    """Draw all quads (Q, 4) into nearness (H, W), 0 at first, and source (H, W, 2); `wraps`: columns of the drawing."""
    quad = np.empty((4, 5), np.float32)
    x, y = quad[:, 0], quad[:, 1]
    span, turn, width = np.float32(MAX_SPAN), np.float32(sphere_width), np.float32(nearness.shape[1])
    bottom_edge, right_edge = np.float32(nearness.shape[0]), np.float32(np.inf) if wraps else width
    for k in range(corners.shape[0]):
        for i in range(4):
            x[i], y[i] = placed[corners[k, i], 0], placed[corners[k, i], 1]
        if not abs(x[0] + x[1] + x[2] + x[3]) >= ZERO:  # NaN: a corner is not seen
            continue
        if wraps and max(x[0], x[1], x[2], x[3]) - min(x[0], x[1], x[2], x[3]) > HALF * width:
            for i in range(4):
                x[i] += width if x[i] < HALF * width else ZERO
        left, right = min(x[0], x[1], x[2], x[3]), max(x[0], x[1], x[2], x[3])
        top, bottom = min(y[0], y[1], y[2], y[3]), max(y[0], y[1], y[2], y[3])
        if max(right - left, bottom - top) > span or bottom < -HALF or top > bottom_edge:
            continue
        if left > right_edge or (right < -HALF and not wraps):
            continue
        if math.ceil(top) > math.floor(bottom) or math.ceil(left) > math.floor(right):  # between pixels
            continue
        for a, b in ((0, 1), (3, 2)):  # left, right
            u, beside = pixels[corners[k, a], 1], pixels[corners[k, b], 1]
            quad[a, 3], quad[b, 3] = u, beside + (turn if beside < u else ZERO)
        for i in range(4):
            q = placed[corners[k, i], 2]
            quad[i, 2], quad[i, 3], quad[i, 4] = q, q * quad[i, 3], q * pixels[corners[k, i], 0]
        _draw(quad, 1, wraps, nearness, source)
        _draw(quad, 2, wraps, nearness, source)
