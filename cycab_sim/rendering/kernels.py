"""Casting of rays, rays that need more samples, light, shadow and lamps, and from light to grey levels."""

import math

import numba.experimental.function_type  # noqa: F401  makes a library's functions arguments of kernels
import numpy as np
from numba import types

from cycab_sim.world.noise.kernels import along
from sphere_nav.kernel_cache.kernels import njit

OUTSIDE = -2  # no ray: the lens does not see there
CONTRAST = 0.02  # edges weaker than this need no more rays: about one grey level
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


@njit(cache=True, nogil=True)
def find_edges(triangles, surface_of, ranges, color, is_edge):
    """Mark pixels (H, W) u1 whose right or lower neighbour shows another surface in another light, and that neighbour.

    triangles (H, W) i32, surface_of (T,) i32, ranges (H, W) f32 m, colour (H, W, 3) f32
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
                is_one = here >= 0 and there >= 0 and surface_of[here] == surface_of[there]
                if is_one and abs(ranges[y, x] - ranges[v, u]) < 0.02 * ranges[v, u]:
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


@njit(cache=True, nogil=True)
def light(origin, rays, ranges, triangles, cone, normals, lamps, is_open, shadow, texel, corner, T_sun_world, color):
    """Turn reflectance into radiance in place, colour (N, 3) f32: sun with cast shadows and an overcast share of sky.

    normals (T, 3) f32 unit; lamps: (unit vector (3,) f64 towards the sun, radiance (3,) of sun and of sky, factor on
    the sky that is seen), see sky.py; is_open (N,) f32: 0 where something that moves hides the sun; shadow (K, K) f32
    distance of the first thing hit by the sun's rays, texel m, corner (2,) m of its first texel, T_sun_world (3, 3):
    rows x, y, -sun
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
        if lambert * is_open[n] > 0.0:
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
def collect_lit(points, normals, lamp, reach, some, rays, distances, lux):
    """Return how many of the points (N, 3) f32 m, normals (N, 3) f32, are before a lamp and within its reach.

    lamp: (place (3,) m, axis (3,), (cosine of the angle where its light ends, where it is full)), all f64, of 1 cd
    out, the first of N rows each: their numbers `some` (N,) i64, unit rays (N, 3) f32 from the lamp, distances (N,)
    f32 m and lux (N,) f32; from 0.7 of its reach on the light fades.
    """
    at, axis, edges = lamp
    count = 0
    for n in range(points.shape[0]):
        x, y, z = points[n, 0] - at[0], points[n, 1] - at[1], points[n, 2] - at[2]
        square = x * x + y * y + z * z
        if square >= reach * reach:
            continue
        facing = -(x * normals[n, 0] + y * normals[n, 1] + z * normals[n, 2])
        distance = max(math.sqrt(square), 0.05)
        share = _ramp((x * axis[0] + y * axis[1] + z * axis[2]) / distance, edges[0], edges[1])
        if facing <= 0.0 or share <= 0.0:
            continue
        if reach < np.inf:
            share *= 1.0 - _ramp(distance, 0.7 * reach, reach)
        some[count], distances[count], lux[count] = n, distance, share * facing / distance**3
        rays[count, 0], rays[count, 1], rays[count, 2] = x / distance, y / distance, z / distance
        count += 1
    return count


@njit(cache=True)
def _ramp(value, low, high):
    """Return 0 below `low`, 1 above `high`, smooth between."""
    t = min(max((value - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


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
