"""The surface that a sphere saw: its pixels joined to quads, large where it is flat, cut where one thing hides another.

A quad joins pixels only where the range goes on from one to the next, so that no sheet is drawn between the edge of a
near thing and what lies behind it. What such a cut uncovers is a hole of the drawing, not a guess.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes, Flags, Floats, Integers
from sphere_nav.spheres.sphere import Sphere, to_rgb
from sphere_nav.view_synthesis.constants import BREAK, FAR_NEARNESS, FLAT, PER_TURN

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
        nearness = np.maximum(1.0 / sphere.range_m, FAR_NEARNESS).astype(np.float32)
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


def _quads(nearness: Floats, camera: Spherical) -> Integers:
    """Return the quads (Q, 3) as upper row, left column and size: the largest where it is flat, each pixel in one."""
    margin = (0, 0), (0, int(camera.is_whole))
    breaks = (find_breaks(nearness, 1, "wrap" if camera.is_whole else "edge"), find_breaks(nearness, 0, "edge"))
    ends_right, ends_below = (np.pad(one, margin, "wrap") for one in breaks)
    around = np.pad(nearness, margin, "wrap")
    is_covered = np.zeros(around.shape, np.bool_)
    size = 1
    while size * 2 * PER_TURN <= camera.full_width:
        size *= 2
    quads = []
    while size:
        found = _is_plane(around, ends_right, ends_below, size)
        rows, columns = (size * (side // size) for side in np.subtract(around.shape, 1))
        found &= ~is_covered[:rows:size, :columns:size]
        is_covered[:rows, :columns] |= found.repeat(size, axis=0).repeat(size, axis=1)
        quads.append(np.pad(size * np.argwhere(found), ((0, 0), (0, 1)), constant_values=size))
        size //= 2
    return np.concatenate(quads)


def find_breaks(nearness: Floats, axis: int, beyond: Any) -> Flags:
    """Return behind which pixels (H, W) along an axis the surface ends: nearness leaps further than on either side.

    So it does on no slanted plane and in no corner of a room. What is unknown (NaN) hides no break. `beyond` the image
    the surface goes on as `np.pad` says.
    """
    margin = [(1, 2) if side == axis else (0, 0) for side in (0, 1)]
    before, here, there, after = np.moveaxis(sliding_window_view(np.pad(nearness, margin, beyond), 4, axis), -1, 0)
    leap = there - here
    usual = np.fmax(np.fmax(np.sign(leap) * (here - before), np.sign(leap) * (after - there)), 0.0)
    share, floor = BREAK
    found: Flags = np.abs(leap) - usual > np.maximum(floor, share * np.maximum(here, there))
    return found


def _is_plane(nearness: Floats, ends_right: Flags, ends_below: Flags, size: int) -> Flags:
    """Return which blocks (M, N) of size x size quads are one plane in nearness, all known and without a break."""
    rows, columns = (side // size for side in np.subtract(nearness.shape, 1))

    def pixels(image: NDArray[Any], i: int, j: int) -> NDArray[Any]:
        """Return pixel (i, j) of every block."""
        return image[i::size, j::size][:rows, :columns]

    (a, b), (c, d) = ([pixels(nearness, i, j) for j in (0, size)] for i in (0, size))
    share, floor = FLAT
    found = np.ones((rows, columns), np.bool_)
    for i, j in np.ndindex(size + 1, size + 1):
        down, across = np.float32(i / size), np.float32(j / size)
        left, right, here = a + down * (c - a), b + down * (d - b), pixels(nearness, i, j)
        found &= np.abs(here - (left + across * (right - left))) <= np.maximum(floor, share * here)
        if j < size:
            found &= ~pixels(ends_right, i, j)
        if i < size:
            found &= ~pixels(ends_below, i, j)
    return found


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
