"""Casting of rays, rays that need more samples, what moves, light and shadow, and from light to grey levels."""

import math

import numba.experimental.function_type  # noqa: F401  makes a library's functions arguments of kernels
import numpy as np
from numba import types

from cycab_sim.world.noise.kernels import along
from sphere_nav.kernel_cache.kernels import njit

OUTSIDE = -2  # no ray: the lens does not see there
CONTRAST = 0.02  # edges weaker than this need no more rays: about one grey level
FRINGE = 0.4  # a triangle darkens texels this far beyond its edges, texels: thin things keep their shadow
FLAT = 1e-9  # a triangle narrower than this, seen from the sun, casts no shadow, texel^2
# rays in packets of eight, through the C interface of Embree 4 (`RTCRayHit8`)
LANES = 8
FIELDS = 24  # of a packet, each of eight 32-bit numbers; the last two are more than it has
DIRECTION, FAR, MASK = 4, 8, 9  # fields of the ray (org x, y, z and near come first)
PRIMITIVE, GEOMETRY = 17, 18  # fields of the hit (normal and u, v come first)
NONE = 0xFFFFFFFF
LUMA = (0.299, 0.587, 0.114)  # of red, green and blue


class PacketFunction(types.WrapperAddressProtocol):
    """A function (addresses of: flags, scene, packet, arguments) of a library, by its address, as a kernel takes it."""

    def __init__(self, address):
        self.address = address

    def __wrapper_address__(self):
        """Return where it is."""
        return self.address

    def signature(self):
        """Return its types."""
        return types.void(types.uint64, types.int64, types.uint64, types.int64)


@njit(cache=True, nogil=True)
def cast_packets(intersect, scene, arguments, origins, rays, first_number, triangles, ranges):
    """Write the first triangle (N,) i32 and its range (N,) f32 that rays (N, 3) f32 meet within a range.

    intersect: `rtcIntersect8`; scene, arguments: addresses; origins (N, 3) f32 m, or one for all (1, 3); first_number
    is added to the triangle's. `ranges` comes in as how far to look; both stay as they are where nothing is met. Rays
    with NaN meet nothing.
    """
    store = np.empty((FIELDS + 3) * LANES, np.float32)
    skip = ((64 - (store.ctypes.data & 63)) & 63) // 4  # which rays are used, and the packet behind, are aligned
    is_used = store[skip : skip + LANES].view(np.int32)
    floats = store[skip + LANES : skip + (FIELDS + 1) * LANES].reshape(FIELDS, LANES)
    words = floats.view(np.uint32)
    num = rays.shape[0]
    words[:] = 0
    for first in range(0, num, LANES):
        for k in range(LANES):
            n = first + k
            is_used[k] = -1 if n < num and rays[n, 0] == rays[n, 0] else 0
            m = min(n, num - 1)
            o = min(m, origins.shape[0] - 1)
            for c in range(3):
                floats[c, k], floats[DIRECTION + c, k] = origins[o, c], rays[m, c]
            floats[3, k], floats[FAR, k] = 0.0, ranges[m]
            words[MASK, k] = words[PRIMITIVE, k] = words[GEOMETRY, k] = NONE
        intersect(is_used.ctypes.data, scene, floats.ctypes.data, arguments)
        for k in range(min(LANES, num - first)):
            if words[GEOMETRY, k] != NONE:
                triangles[first + k] = first_number + np.int32(words[PRIMITIVE, k])
                ranges[first + k] = floats[FAR, k]


@njit(cache=True, nogil=True)
def turn_rays(rays, R, out):
    """Write rays (N, 3) f32 turned by a rotation (3, 3) f32; a library's threads cost more than such a product."""
    for n in range(rays.shape[0]):
        for c in range(3):
            out[n, c] = along(R, c, rays[n])


@njit(cache=True)
def place_parts(T_world_part, part_of_triangle, part_of_surface, local, moved):
    """Move triangles (T, 3, 3), normals (T, 3) and surface frames (S, 3, 4), all f32, by their parts' poses.

    T_world_part (P, 4, 4) f64; local, moved: (triangles, normals, frames); frames map the world to the surface.
    """
    for t in range(part_of_triangle.shape[0]):
        m = T_world_part[part_of_triangle[t]]
        for r in range(3):
            for k in range(3):
                moved[0][t, k, r] = along(m, r, local[0][t, k]) + m[r, 3]
            moved[1][t, r] = along(m, r, local[1][t])
    for s in range(part_of_surface.shape[0]):
        m, f, out = T_world_part[part_of_surface[s]], local[2][s], moved[2][s]
        for r in range(3):
            shift = 0.0
            for c in range(3):
                turned = along(f, r, m[c])
                out[r, c] = turned
                shift += turned * m[c, 3]
            out[r, 3] = f[r, 3] - shift


@njit(cache=True, nogil=True)
def find_edges(triangles, surface_of, normals, ranges, color, is_edge):
    """Mark pixels (H, W) u1 whose right or lower neighbour shows another surface in another light, and that neighbour.

    triangles (H, W) i32, surface_of (T,) i32, normals (T, 3) f32, ranges (H, W) f32 m, colour (H, W, 3) f32
    """
    height, width = triangles.shape
    is_edge[:] = 0
    for v in range(height):
        for u in range(width):
            here = triangles[v, u]
            for k in range(2):
                y, x = v + k, u + 1 - k
                if y >= height or x >= width:
                    continue
                there = triangles[y, x]
                if there == here or min(there, here) == OUTSIDE or _alike(color, v, u, y, x):
                    continue
                if here >= 0 and there >= 0 and surface_of[here] == surface_of[there]:
                    is_level = abs(ranges[y, x] - ranges[v, u]) < 0.02 * ranges[v, u]
                    if is_level or _parallel(normals, here, there):
                        continue
                is_edge[v, u] = is_edge[y, x] = 1


@njit(cache=True)
def _alike(color, v, u, y, x):
    """Whether two pixels differ by less than CONTRAST."""
    difference, total = 0.0, 0.0
    for c in range(3):
        difference += abs(color[v, u, c] - color[y, x, c])
        total += color[v, u, c] + color[y, x, c]
    return difference < CONTRAST * total


@njit(cache=True)
def _parallel(normals, here, there):
    """Whether two triangles of one surface lie in one plane."""
    return abs(along(normals, here, normals[there])) > 0.9999


@njit(cache=True, nogil=True)
def split_rays(rays, edges, n, out):
    """Write n x n rays per edge pixel: out (E n n, 3) f32 from rays (H, W, 3) f32 and edges (E,) i64 flat indices."""
    width = rays.shape[1]
    for e in range(edges.shape[0]):
        v, u = edges[e] // width, edges[e] % width
        left, right = _nearest_ray(rays, v, u, 0, -1), _nearest_ray(rays, v, u, 0, 1)
        above, below = _nearest_ray(rays, v, u, -1, 0), _nearest_ray(rays, v, u, 1, 0)
        for k in range(n * n):
            a = ((k % n + 0.5) / n - 0.5) / max(right - left, 1)
            b = ((k // n + 0.5) / n - 0.5) / max(below - above, 1)
            square = 0.0
            for c in range(3):
                ray = rays[v, u, c] + a * (rays[v, right, c] - rays[v, left, c])
                ray += b * (rays[below, u, c] - rays[above, u, c])
                out[e * n * n + k, c] = ray
                square += ray * ray
            for c in range(3):
                out[e * n * n + k, c] /= math.sqrt(square)


@njit(cache=True)
def _nearest_ray(rays, v, u, dv, du):
    """Return the row or column of a neighbour, or the pixel's own where that is beyond the image or the lens."""
    y, x = v + dv, u + du
    if y < 0 or x < 0 or y >= rays.shape[0] or x >= rays.shape[1] or math.isnan(rays[y, x, 0]):
        y, x = v, u
    return y if dv != 0 else x


@njit(cache=True)
def cast_shadows(triangles, T_sun_world, corner, texel, shadow):
    """Draw triangles (T, 3, 3) f32 into a shadow map (K, K) f32 by the nearest depth.

    T_sun_world (3, 3), corner (2,) m, texel m: see `light`
    """
    points = np.empty((3, 3))
    for t in range(triangles.shape[0]):
        for k in range(3):
            for r in range(3):
                points[k, r] = along(T_sun_world, r, triangles[t, k])
            points[k, 0], points[k, 1] = (points[k, 0] - corner[0]) / texel, (points[k, 1] - corner[1]) / texel
        _draw_shadow(points, shadow)


@njit(cache=True)
def _draw_shadow(p, shadow):
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
    for j in _texels(p[:, 1], shadow.shape[0]):
        for i in _texels(p[:, 0], shadow.shape[1]):
            x, y = i - p[0, 0], j - p[0, 1]
            s, t = (x * by - y * bx) / area, (ax * y - ay * x) / area
            if s < -slack_1 or t < -slack_2 or 1.0 - s - t < -slack_0:
                continue
            depth = p[0, 2] + s * (p[1, 2] - p[0, 2]) + t * (p[2, 2] - p[0, 2])
            shadow[j, i] = min(shadow[j, i], np.float32(min(max(depth, low), high)))


@njit(cache=True)
def _texels(x, size):
    """Return the rows, or the columns, that a triangle and its fringe cover."""
    return range(max(0, math.ceil(x.min() - FRINGE)), min(size - 1, math.floor(x.max() + FRINGE)) + 1)


@njit(cache=True, nogil=True)
def light(origin, rays, ranges, triangles, cone, normals, lamps, shadow, texel, corner, T_sun_world, color):
    """Turn reflectance into radiance in place, colour (N, 3) f32: sun with cast shadows and an overcast share of sky.

    normals (T, 3) f32 unit; lamps: (unit vector (3,) f64 towards the sun, radiance (3,) of sun and of sky, factor on
    the sky that is seen), see sky.py; shadow (K, K) f32 distance of the first
    thing hit by the sun's rays, texel m, corner (2,) m of its first texel, T_sun_world (3, 3): rows x, y, -sun
    """
    sun, sun_color, sky_color, sky_gain = lamps
    out = np.empty(3)  # a point just above what was hit
    for n in range(rays.shape[0]):
        t = triangles[n]
        if t < 0:
            for c in range(3):
                color[n, c] *= sky_gain
            continue
        side = -1.0 if along(normals, t, rays[n]) > 0.0 else 1.0
        lambert = side * along(normals, t, sun)
        direct = 0.0
        if lambert > 0.0:
            for c in range(3):
                out[c] = origin[c] + ranges[n] * rays[n, c] + 1.2 * texel * (side * normals[t, c])
            a, b = along(T_sun_world, 0, out) - corner[0], along(T_sun_world, 1, out) - corner[1]
            depth = along(T_sun_world, 2, out) - 0.5 * texel
            direct = lambert * _lit(shadow, a / texel, b / texel, depth, ranges[n] * cone[n] / texel)
        z = origin[2] + ranges[n] * rays[n, 2]
        sky = (0.62 + 0.38 * (side * normals[t, 2])) * (0.55 + 0.45 * min(1.0, (z + 0.8) / 7.0))
        for c in range(3):
            color[n, c] *= sun_color[c] * direct + sky_color[c] * sky


@njit(cache=True)
def _lit(shadow, a, b, depth, footprint):
    """Share of the sun that reaches a point, the mean over four points when the footprint is wider than a texel."""
    if footprint < 1.0:
        return _lit_once(shadow, a, b, depth)
    s = 0.3 * footprint
    total = _lit_once(shadow, a - s, b - s, depth) + _lit_once(shadow, a + s, b - s, depth)
    return 0.25 * (total + _lit_once(shadow, a - s, b + s, depth) + _lit_once(shadow, a + s, b + s, depth))


@njit(cache=True, nogil=True)
def compare_depths(shadow, at, depths, lit):
    """Write the share (N,) f32 of light that reaches points at columns and rows (N, 2) f32 and depths (N,) f32 m."""
    for n in range(lit.size):
        lit[n] = _lit_once(shadow, at[n, 0], at[n, 1], depths[n])


@njit(cache=True)
def _lit_once(shadow, a, b, depth):
    """Compare with the four texels around (a, b) and blend; the world beyond the map is lit."""
    i, j = math.floor(a), math.floor(b)
    if i < 0 or j < 0 or i + 1 >= shadow.shape[1] or j + 1 >= shadow.shape[0]:
        return 1.0
    s, t = a - i, b - j
    total = (1.0 - s) * (1.0 - t) if depth <= shadow[j, i] else 0.0
    total += s * (1.0 - t) if depth <= shadow[j, i + 1] else 0.0
    total += (1.0 - s) * t if depth <= shadow[j + 1, i] else 0.0
    return total + (s * t if depth <= shadow[j + 1, i + 1] else 0.0)


@njit(cache=True, nogil=True)
def tone(color, gain, curve, image):
    """Write grey levels 0..255 f32, image (N, 3) RGB or (N, 1) luma, of radiance (N, 3) f32 by a curve (K,).

    gain (3,) f64: factors on red, green and blue
    """
    last = curve.shape[0] - 1
    for n in range(color.shape[0]):
        luma = 0.0
        for c in range(3):
            x = min(max(gain[c] * color[n, c], 0.0), 1.0) * last
            k = min(int(x), last - 1)
            level = curve[k] + (x - k) * (curve[k + 1] - curve[k])
            luma += level * LUMA[c]
            if image.shape[1] == 3:
                image[n, c] = level
        if image.shape[1] == 1:
            image[n, 0] = luma
