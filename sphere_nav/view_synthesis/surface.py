"""The surface that a sphere saw: its pixels joined to quads, large where it is flat, cut where one thing hides another.

A quad joins pixels only where the range goes on from one to the next, so that no sheet is drawn between the edge of a
near thing and what lies behind it. What such a cut uncovers is a hole of the drawing, not a guess.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes, Floats, Integers
from sphere_nav.spheres.sphere import Sphere, to_rgb
from sphere_nav.view_synthesis import kernels
from sphere_nav.view_synthesis.constants import BREAK, FLAT, PER_TURN

Indices = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Surface:
    """What a sphere saw, ready to be drawn from elsewhere.

    points (3, N) f32 m in the sphere frame and their pixels (N, 2) f32 (v, u): the corners; corners (Q, 4) i32 are
    those of each quad, clockwise in the image; image (H, W, 3) u8.
    """

    points: Floats
    pixels: Floats
    corners: Indices
    image: Bytes
    camera: Spherical

    @property
    def num_bytes(self) -> int:
        """Memory that it takes."""
        return sum(array.nbytes for array in (self.points, self.pixels, self.corners, self.image))


def surface_of(sphere: Sphere) -> Surface:
    """Return the surface of a sphere; pixels without range are left out, those of the sky lie far away."""
    camera, wraps = sphere.camera, sphere.camera.is_whole
    with np.errstate(divide="ignore"):
        nearness = np.maximum(1.0 / sphere.range_m, kernels.FAR_NEARNESS).astype(np.float32)
    quads = _quads(nearness, camera)
    rows = quads[:, :1] + quads[:, 2:] * (0, 0, 1, 1)  # around: upper left, upper right, lower right, lower left
    columns = (quads[:, 1:2] + quads[:, 2:] * (0, 1, 1, 0)) % camera.width
    is_used = np.zeros(nearness.shape, np.bool_)
    is_used[rows, columns] = True
    numbers = np.cumsum(is_used).reshape(nearness.shape) - 1
    used = np.argwhere(is_used)
    points = (camera.unproject(used[:, ::-1]) / nearness[is_used][:, None]).astype(np.float32)
    parts = [(points, used.astype(np.float32), numbers[rows, columns].astype(np.int32))]
    for row in (0, camera.height - 1) if wraps else ():
        if np.all(is_used[row]):
            parts.append(_cap(points[numbers[row]], numbers[row], row, sum(len(part[0]) for part in parts)))
    points, pixels, corners = (np.concatenate(one) for one in zip(*parts, strict=True))
    pixels = np.ascontiguousarray(pixels)  # a kernel is compiled for each order
    image = np.ascontiguousarray(to_rgb(sphere.image))
    return Surface(np.ascontiguousarray(points.T), pixels, corners, image, camera)


def _quads(nearness: Floats, camera: Spherical) -> Indices:
    """Return the quads (Q, 3) as upper row, left column and size."""
    breaks = np.zeros(nearness.shape, np.uint8)
    kernels.find_breaks(nearness, camera.is_whole, *BREAK, breaks)
    largest = 1
    while largest * 2 * PER_TURN <= camera.full_width:
        largest *= 2
    quads = np.empty((nearness.size, 3), np.int32)
    return quads[: kernels.cut_quads(nearness, breaks, camera.is_whole, largest, *FLAT, quads)]


def _cap(ring: Floats, numbers: Integers, row: int, first: int) -> tuple[Floats, Floats, Indices]:
    """Return the corners that close a whole sphere at a pole: triangles from the outermost row (W, 3) to one point.

    `first` is the number of the next corner; the pole has W of them, one for each column.
    """
    count = len(ring)
    points = np.repeat(ring.mean(axis=0, keepdims=True), count, axis=0)
    columns = np.arange(count)
    pixels = np.stack([np.full(count, row - 0.5 if row == 0 else row + 0.5), columns], axis=1).astype(np.float32)
    tips = first + np.stack([columns, np.roll(columns, -1)], axis=1)
    edge = np.stack([numbers, np.roll(numbers, -1)], axis=1)
    upper, lower = (tips, edge) if row == 0 else (edge, tips)
    return points, pixels, np.hstack([upper, lower[:, ::-1]]).astype(np.int32)
