"""Rays in packets of eight, through the C interface of Embree 4 (`RTCRayHit8`)."""

import numba.experimental.function_type  # noqa: F401  makes a library's functions arguments of kernels
import numpy as np
from numba import types

from sphere_nav.kernel_cache.kernels import njit

LANES = 8
FIELDS = 24  # of a packet, each of eight 32-bit numbers; the last two are more than it has
DIRECTION, TIME, FAR, MASK, FLAGS = 4, 7, 8, 9, 11  # fields of the ray (org x, y, z and near come first)
PRIMITIVE, GEOMETRY = 17, 18  # fields of the hit (normal and u, v come first)
NONE = 0xFFFFFFFF


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
def cast(intersect, scene, arguments, origin, rays, first_number, triangles, ranges):
    """Write the first triangle (N,) i32 and its range (N,) f32 that rays (N, 3) f32 from a point meet within a range.

    intersect: `rtcIntersect8`; scene, arguments: addresses; origin (3,) m; first_number is added to the triangle's.
    `ranges` comes in as how far to look; both stay as they are where nothing is met. Rays with NaN meet nothing.
    """
    store = np.empty((FIELDS + 3) * LANES, np.float32)
    skip = ((64 - (store.ctypes.data & 63)) & 63) // 4  # packets are aligned
    floats = store[skip : skip + FIELDS * LANES].reshape(FIELDS, LANES)
    words = floats.view(np.uint32)
    flags = np.empty(4 * LANES, np.int32)
    skip = ((64 - (flags.ctypes.data & 63)) & 63) // 4
    is_used = flags[skip : skip + LANES]
    num = rays.shape[0]
    words[:] = 0
    for first in range(0, num, LANES):
        for k in range(LANES):
            n = first + k
            is_used[k] = -1 if n < num and rays[n, 0] == rays[n, 0] else 0
            m = min(n, num - 1)
            for c in range(3):
                floats[c, k], floats[DIRECTION + c, k] = origin[c], rays[m, c]
            floats[3, k], floats[FAR, k] = 0.0, ranges[m]
            words[MASK, k] = words[PRIMITIVE, k] = words[GEOMETRY, k] = NONE
        intersect(is_used.ctypes.data, scene, floats.ctypes.data, arguments)
        for k in range(min(LANES, num - first)):
            if words[GEOMETRY, k] != NONE:
                triangles[first + k] = first_number + np.int32(words[PRIMITIVE, k])
                ranges[first + k] = floats[FAR, k]
