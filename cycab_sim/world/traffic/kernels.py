"""Moving things to where they are, the shadows they cast, and where there is room to walk."""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import njit

FRINGE = 0.4  # a triangle darkens texels this far beyond its edges, texels: thin things keep their shadow
FLAT = 1e-9  # a triangle narrower than this, seen from the sun, casts no shadow, texel^2


@njit(cache=True)
def place_parts(T_world_part, part_of_triangle, part_of_surface, local, moved):
    """Move triangles (T, 3, 3), normals (T, 3) and surface frames (S, 3, 4), all f32, by their parts' poses.

    T_world_part (P, 4, 4) f64; local, moved: (triangles, normals, frames); frames map the world to the surface.
    """
    for t in range(part_of_triangle.shape[0]):
        m = T_world_part[part_of_triangle[t]]
        for r in range(3):
            for k in range(3):
                p = local[0][t, k]
                moved[0][t, k, r] = m[r, 0] * p[0] + m[r, 1] * p[1] + m[r, 2] * p[2] + m[r, 3]
            n = local[1][t]
            moved[1][t, r] = m[r, 0] * n[0] + m[r, 1] * n[1] + m[r, 2] * n[2]
    for s in range(part_of_surface.shape[0]):
        m, f, out = T_world_part[part_of_surface[s]], local[2][s], moved[2][s]
        for r in range(3):
            shift = 0.0
            for c in range(3):
                turned = f[r, 0] * m[c, 0] + f[r, 1] * m[c, 1] + f[r, 2] * m[c, 2]
                out[r, c] = turned
                shift += turned * m[c, 3]
            out[r, 3] = f[r, 3] - shift


@njit(cache=True)
def erase_shadows(windows, still, shadow):
    """Restore the texels (first column, first row, last column, last row) (T, 4) i32 of `shadow` from `still`."""
    for t in range(windows.shape[0]):
        for j in range(windows[t, 1], windows[t, 3] + 1):
            for i in range(windows[t, 0], windows[t, 2] + 1):
                shadow[j, i] = still[j, i]


@njit(cache=True)
def cast_shadows(triangles, T_sun_world, corner, texel, windows, shadow):
    """Draw triangles (T, 3, 3) f32 into a shadow map (K, K) f32 by the nearest depth, and note where: windows (T, 4).

    T_sun_world (3, 3), corner (2,) m, texel m: see `cycab_sim.rendering.kernels.light`
    """
    points = np.empty((3, 3))
    for t in range(triangles.shape[0]):
        for k in range(3):
            for r in range(3):
                p = triangles[t, k]
                points[k, r] = T_sun_world[r, 0] * p[0] + T_sun_world[r, 1] * p[1] + T_sun_world[r, 2] * p[2]
            points[k, 0], points[k, 1] = (points[k, 0] - corner[0]) / texel, (points[k, 1] - corner[1]) / texel
        for r in range(2):
            low, high = points[:, r].min() - FRINGE, points[:, r].max() + FRINGE
            windows[t, r] = max(0, math.ceil(low)) if low < shadow.shape[0] else shadow.shape[0]
            windows[t, r + 2] = min(shadow.shape[0] - 1, math.floor(high)) if high >= 0.0 else -1
        _draw(points, windows[t], shadow)


@njit(cache=True)
def _draw(p, window, shadow):
    """Draw one triangle (3, 3): column, row, depth."""
    ax, ay = p[1, 0] - p[0, 0], p[1, 1] - p[0, 1]
    bx, by = p[2, 0] - p[0, 0], p[2, 1] - p[0, 1]
    area = ax * by - ay * bx
    if abs(area) < FLAT:
        return
    # a point beyond an edge by FRINGE has a negative share of the corner opposite to it
    slack_1 = FRINGE * math.sqrt(bx * bx + by * by) / abs(area)
    slack_2 = FRINGE * math.sqrt(ax * ax + ay * ay) / abs(area)
    slack_0 = FRINGE * math.sqrt((bx - ax) ** 2 + (by - ay) ** 2) / abs(area)
    low, high = min(p[0, 2], p[1, 2], p[2, 2]), max(p[0, 2], p[1, 2], p[2, 2])
    for j in range(window[1], window[3] + 1):
        for i in range(window[0], window[2] + 1):
            x, y = i - p[0, 0], j - p[0, 1]
            s, t = (x * by - y * bx) / area, (ax * y - ay * x) / area
            if s < -slack_1 or t < -slack_2 or 1.0 - s - t < -slack_0:
                continue
            depth = p[0, 2] + s * (p[1, 2] - p[0, 2]) + t * (p[2, 2] - p[0, 2])
            shadow[j, i] = min(shadow[j, i], np.float32(min(max(depth, low), high)))


@njit(cache=True)
def mark(boxes, grid):
    """Set the cells (first column, first row, last column, last row) (N, 4) i64 of a grid (H, W) u1 to 0."""
    for n in range(boxes.shape[0]):
        for j in range(max(0, boxes[n, 1]), min(grid.shape[0] - 1, boxes[n, 3]) + 1):
            for i in range(max(0, boxes[n, 0]), min(grid.shape[1] - 1, boxes[n, 2]) + 1):
                grid[j, i] = 0
