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
def find_breaks(nearness, wraps, share, floor, breaks):
    """Mark in breaks (H, W) u8 where the surface ends to the right (1) and below (2) of a pixel of nearness (H, W)."""
    height, width = nearness.shape
    for v in range(height):
        for u in range(width):
            a, found = nearness[v, u], 0
            if wraps or u + 1 < width:
                left = nearness[v, u - 1] if wraps or u > 0 else a
                right, next_right = nearness[v, (u + 1) % width], nearness[v, (u + 2) % width]
                next_right = next_right if wraps or u + 2 < width else right
                found += 1 if is_edge(left, a, right, next_right, share, floor) else 0
            if v + 1 < height:
                above, below = nearness[max(v - 1, 0), u], nearness[v + 1, u]
                next_below = nearness[min(v + 2, height - 1), u]
                found += 2 if is_edge(above, a, below, next_below, share, floor) else 0
            breaks[v, u] = found


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
    d, r = np.empty(BLOCK, np.float32), np.empty(SCRATCH, np.float32)
    nothing = np.float32(np.nan)
    for first in range(0, number, SIDE):
        here = min(SIDE, number - first)
        for i in range(SIDE):
            k = first + i if i < here else first
            d[PX + i], d[PY + i], d[PZ + i] = points[0, k], points[1, k], points[2, k]
        transform(T, d, r)
        distance2 = np.empty(SIDE, np.float32)  # rows X, Y, Z are the projection's to overwrite
        for i in range(SIDE):
            distance2[i] = r[X + i] * r[X + i] + r[Y + i] * r[Y + i] + r[Z + i] * r[Z + i]
        project(camera[0], camera[1], r)
        for i in range(here):
            seen = r[SEEN + i] > ZERO and distance2[i] > ZERO
            placed[first + i, 0] = r[U + i] if seen else nothing
            placed[first + i, 1] = r[V + i] if seen else nothing
            placed[first + i, 2] = ONE / np.float32(math.sqrt(distance2[i])) if seen else nothing


@njit(**OPTIONS)
def _draw(x, y, q, u, v, wraps, nearness, source):
    """Draw one triangle seen from its front: nearness and, in perspective, the place (u, v) in the sphere's image."""
    height, width = nearness.shape
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    if not area > MIN_AREA:  # seen from behind, or not at all
        return
    top, bottom = min(y[0], y[1], y[2]), max(y[0], y[1], y[2])
    left, right = min(x[0], x[1], x[2]), max(x[0], x[1], x[2])
    first_row, last_row = max(math.ceil(top), 0), min(math.floor(bottom), height - 1)
    first, last = math.ceil(left), math.floor(right)
    if not wraps:
        first, last = max(first, 0), min(last, width - 1)
    by_area = ONE / area
    b_x, b_y = (y[2] - y[0]) * by_area, (x[0] - x[2]) * by_area
    c_x, c_y = (y[0] - y[1]) * by_area, (x[1] - x[0]) * by_area
    u0, u1, u2 = u[0] * q[0], u[1] * q[1], u[2] * q[2]
    v0, v1, v2 = v[0] * q[0], v[1] * q[1], v[2] * q[2]
    for row in range(first_row, last_row + 1):
        dy = np.float32(row) - y[0]
        for column in range(first, last + 1):
            dx = np.float32(column) - x[0]
            b, c = b_x * dx + b_y * dy, c_x * dx + c_y * dy
            a = ONE - b - c
            if a < -EDGE or b < -EDGE or c < -EDGE:
                continue
            here = a * q[0] + b * q[1] + c * q[2]
            at = column % width if wraps else column
            if here > nearness[row, at]:
                nearness[row, at] = here
                source[row, at, 0] = (a * u0 + b * u1 + c * u2) / here
                source[row, at, 1] = (a * v0 + b * v1 + c * v2) / here


@njit(**OPTIONS)
def draw_quads(corners, placed, pixels, sphere_width, wraps, nearness, source):
    """Draw all quads (Q, 4) into nearness (H, W), 0 at first, and source (H, W, 2); `wraps`: columns of the drawing."""
    height, width = nearness.shape
    x, y, q = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    u, v = np.empty(3, np.float32), np.empty(3, np.float32)
    span, turn = np.float32(MAX_SPAN), np.float32(sphere_width)
    low, right_edge, bottom_edge = -HALF, np.float32(width), np.float32(height)
    for k in range(corners.shape[0]):
        a, b, c, d = corners[k, 0], corners[k, 1], corners[k, 2], corners[k, 3]
        xa, xb, xc, xd = placed[a, 0], placed[b, 0], placed[c, 0], placed[d, 0]
        if not abs(xa + xb + xc + xd) >= ZERO:  # NaN: a corner is not seen
            continue
        if wraps and max(xa, xb, xc, xd) - min(xa, xb, xc, xd) > HALF * width:
            xa, xb = (xa + width if xa < HALF * width else xa), (xb + width if xb < HALF * width else xb)
            xc, xd = (xc + width if xc < HALF * width else xc), (xd + width if xd < HALF * width else xd)
        left, right = min(xa, xb, xc, xd), max(xa, xb, xc, xd)
        ya, yb, yc, yd = placed[a, 1], placed[b, 1], placed[c, 1], placed[d, 1]
        top, bottom = min(ya, yb, yc, yd), max(ya, yb, yc, yd)
        if bottom < low or top > bottom_edge or right - left > span or bottom - top > span:
            continue
        if not wraps and (right < low or left > right_edge):
            continue
        if math.ceil(top) > math.floor(bottom) or math.ceil(left) > math.floor(right):  # between pixels
            continue
        ua, ub, uc, ud = pixels[a, 1], pixels[b, 1], pixels[c, 1], pixels[d, 1]
        ub, uc = (ub + turn if ub < ua else ub), (uc + turn if uc < ud else uc)
        va, vb, vc, vd = pixels[a, 0], pixels[b, 0], pixels[c, 0], pixels[d, 0]
        x[0], x[1], x[2], y[0], y[1], y[2] = xa, xb, xc, ya, yb, yc
        q[0], q[1], q[2] = placed[a, 2], placed[b, 2], placed[c, 2]
        u[0], u[1], u[2], v[0], v[1], v[2] = ua, ub, uc, va, vb, vc
        _draw(x, y, q, u, v, wraps, nearness, source)
        x[1], x[2], y[1], y[2] = xc, xd, yc, yd
        q[1], q[2] = placed[c, 2], placed[d, 2]
        u[1], u[2], v[1], v[2] = uc, ud, vc, vd
        _draw(x, y, q, u, v, wraps, nearness, source)
