"""Which surfaces a lamp would light if nothing stood between."""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import njit


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
