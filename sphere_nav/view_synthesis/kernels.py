"""Kernels of view synthesis: pieces of the surface of a sphere drawn with a z-buffer.

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

EDGE = np.float32(1e-4)  # of a triangle: pixels that lie on the edge of two belong to both
MIN_AREA = np.float32(1e-6)  # px^2, twice the area of a triangle
MAX_SPAN = 512  # px, of a quad in the drawing: wider ones touch the camera
ZERO, ONE, HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)


@njit(**OPTIONS)
def project_corners(points, T, camera, placed):
    """Project points (3, N) f32 m into an image: placed (N, 3) = u, v, nearness to the camera; NaN where not seen."""
    number = points.shape[1]
    d, r, distances = np.zeros(BLOCK, np.float32), np.empty(SCRATCH, np.float32), np.empty(SIDE, np.float32)
    for first in range(0, number, SIDE):
        here = min(SIDE, number - first)
        for axis, row in enumerate((PX, PY, PZ)):
            d[row : row + here] = points[axis, first : first + here]
        transform(T, d, r)
        for i in range(SIDE):  # rows X, Y, Z are the projection's to overwrite
            distances[i] = math.sqrt(r[X + i] * r[X + i] + r[Y + i] * r[Y + i] + r[Z + i] * r[Z + i])
        project(camera[0], camera[1], r)
        for i in range(here):
            known = ONE if r[SEEN + i] > ZERO and distances[i] > ZERO else np.float32(np.nan)
            corner = placed[first + i]
            corner[0], corner[1], corner[2] = known * r[U + i], known * r[V + i], known / distances[i]


@njit(**OPTIONS)
def _draw(p, q, r, wraps, nearness, source):
    """Draw one triangle seen from its front: nearness and, in perspective, the place (u, v) in the sphere's image.

    p, q, r: corners (5,), clockwise: x, y, nearness, and by that u, v.
    """
    height, width = nearness.shape
    area = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1])
    if not area > MIN_AREA:  # seen from behind, or not at all
        return
    first_row, last_row = max(math.ceil(min(p[1], q[1], r[1])), 0), min(math.floor(max(p[1], q[1], r[1])), height - 1)
    first, last = math.ceil(min(p[0], q[0], r[0])), math.floor(max(p[0], q[0], r[0]))
    if not wraps:
        first, last = max(first, 0), min(last, width - 1)
    by_area = ONE / area
    b_x, b_y = (r[1] - p[1]) * by_area, (p[0] - r[0]) * by_area
    c_x, c_y = (p[1] - q[1]) * by_area, (q[0] - p[0]) * by_area
    for row in range(first_row, last_row + 1):
        dy = np.float32(row) - p[1]
        for column in range(first, last + 1):
            dx = np.float32(column) - p[0]
            b, c = b_x * dx + b_y * dy, c_x * dx + c_y * dy
            a = ONE - b - c
            if a < -EDGE or b < -EDGE or c < -EDGE:
                continue
            here = a * p[2] + b * q[2] + c * r[2]
            at = column % width if wraps else column
            if here > nearness[row, at]:
                nearness[row, at] = here
                source[row, at, 0] = (a * p[3] + b * q[3] + c * r[3]) / here
                source[row, at, 1] = (a * p[4] + b * q[4] + c * r[4]) / here


@njit(**OPTIONS)
def _unwrap(a, b, c, d, axis, turn):
    """Add a turn to the lower ones of four corners that lie on both sides of the end of an axis."""
    half = HALF * np.float32(turn)
    if max(a[axis], b[axis], c[axis], d[axis]) - min(a[axis], b[axis], c[axis], d[axis]) > half:
        for corner in (a, b, c, d):
            corner[axis] += np.float32(turn) if corner[axis] < half else ZERO


@njit(**OPTIONS)
def draw_quads(corners, placed, pixels, sphere_width, wraps, nearness, source):
    """Draw all quads (Q, 4) into nearness (H, W), 0 at first, and source (H, W, 2); `wraps`: columns of the drawing."""
    height, width = nearness.shape
    quad = np.empty((4, 5), np.float32)  # of each corner what `_draw` takes
    a, b, c, d = quad[0], quad[1], quad[2], quad[3]
    for k in range(len(corners)):
        for i in range(4):
            corner = corners[k, i]
            quad[i, 0], quad[i, 1], quad[i, 2] = placed[corner, 0], placed[corner, 1], placed[corner, 2]
            quad[i, 3], quad[i, 4] = pixels[corner, 1], pixels[corner, 0]
        if math.isnan(a[0] + b[0] + c[0] + d[0]):  # a corner is not seen
            continue
        if wraps:
            _unwrap(a, b, c, d, 0, width)
        left, right = min(a[0], b[0], c[0], d[0]), max(a[0], b[0], c[0], d[0])
        top, bottom = min(a[1], b[1], c[1], d[1]), max(a[1], b[1], c[1], d[1])
        if bottom < -HALF or top > height or right - left > MAX_SPAN or bottom - top > MAX_SPAN:
            continue
        if not wraps and (right < -HALF or left > width):
            continue
        if math.ceil(top) > math.floor(bottom) or math.ceil(left) > math.floor(right):  # between pixels
            continue
        _unwrap(a, b, c, d, 3, sphere_width)
        for i in range(4):
            quad[i, 3] *= quad[i, 2]
            quad[i, 4] *= quad[i, 2]
        _draw(a, b, c, wraps, nearness, source)
        _draw(a, c, d, wraps, nearness, source)
