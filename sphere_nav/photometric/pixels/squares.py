"""The pixels of a reference in squares, each made into points and gradients when a camera first sees it.

A whole sphere has millions of pixels, of which one camera sees some per cent. What is chosen does not depend on which
squares were made before. A camera that turns leaves squares behind; they are forgotten when they are a quarter as many
as those that it sees. Several threads may ask: what one was given is never changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import empty_to_keep
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.constants import MAX_VIEWS, MIN_SQUARES, SQUARE_MARGIN
from sphere_nav.photometric.pixels import kernels
from sphere_nav.photometric.pixels.pyramid import Floats, kernel_camera, kernel_motion, view_cone

Indices = NDArray[np.int32]
Steps = NDArray[np.uint16]
GROWTH = 0.125  # of the room that is made beyond what is needed
NOT_YET = -1


class Seen(NamedTuple):
    """Squares that a camera may see: places (K,) in `pool` (S * BLOCK,) and `keys` (S * SIDE, 6) of all that are."""

    places: Indices
    pool: Floats
    keys: NDArray[np.uint8]


class Squares:
    """Pixels of one level; `num_pixels` of them have a range."""

    def __init__(self, image: Steps, camera: Camera, pad: int, ranges: Steps, far: float) -> None:
        """An image and its ranges (H, W) as `kernels.quantize` and `kernels.encode_range` make them; +Inf: `far` m."""
        self.camera, self._ranges, self._far = camera, ranges, np.float32(far)
        self._image, self._pad, self._lock = image, pad, Lock()
        cones, self._order = cones_of(camera), curve(camera.width, camera.height)
        self.bounds = empty_to_keep((len(cones), 4), np.float32)
        self.num_pixels = int(kernels.bound_squares(ranges, kernels.RANGES, self._far, pad, cones, self.bounds))
        self._own_bytes = image.nbytes + ranges.nbytes + self.bounds.nbytes
        self._made = Made.nothing(len(cones))

    @property
    def num_bytes(self) -> int:
        """Memory that the level takes now."""
        return self._own_bytes + self._made.pool.nbytes + self._made.keys.nbytes

    def near(self, T_camera_reference: SE3, camera: Camera, *, is_thinned: bool = False) -> Seen:
        """Return the squares that a camera may see, along a curve on which neighbours stay together.

        A sphere far ahead shows most of its pixels in a small part of the image. Where it `is_thinned`, every second of
        the curve is left out, or every fourth, ..., until about as many are left as it would show of its own place.
        """
        found, order, cone = np.empty(len(self.bounds), np.int32), self._order, view_cone(camera)
        T = kernel_motion(T_camera_reference.matrix)
        number = kernels.find_squares(self.bounds, order, T, cone, found)
        if is_thinned and number > MIN_SQUARES:
            there = T.copy()
            there[:, 3] = 0.0
            usual = max(kernels.find_squares(self.bounds, order, there, cone, np.empty_like(found)), MIN_SQUARES)
            order = np.ascontiguousarray(order[:: 1 << max(0, round(math.log2(number / usual)))])
            number = kernels.find_squares(self.bounds, order, T, cone, found)
        return self._fill(found[:number])

    def all(self) -> Seen:
        """Return all squares, along the same curve."""
        return self._fill(self._order[self.bounds[self._order, 3] >= 0])

    def _fill(self, squares: Indices) -> Seen:
        made = self._made
        if np.any(made.place_of[squares] == NOT_YET):
            with self._lock:
                made = self._make(squares)
        return Seen(made.place_of[squares], made.pool, made.keys)

    def _make(self, squares: Indices) -> Made:
        """Make those of the squares that are missing; begin anew where too many would be kept."""
        made = self._made
        missing = squares[made.place_of[squares] == NOT_YET]
        if made.number + missing.size > max(MAX_VIEWS * squares.size, MIN_SQUARES):
            made, missing = Made.nothing(len(self.bounds)), squares
        first, last = made.number, made.number + missing.size
        if last * BLOCK > made.pool.size:
            made = made.with_room(min(last + int(GROWTH * last), len(self.bounds)))
        ranges = self._ranges, kernels.RANGES, self._far
        camera = kernel_rays(self.camera), kernel_camera(self.camera)
        kernels.fill_squares(missing, first, self._image, self._pad, *ranges, *camera, made.pool, made.keys)
        made.place_of[missing] = np.arange(first, last, dtype=np.int32)
        made.number = last
        self._made = made
        return made


@dataclass
class Made:
    """Squares that were made: `number` of them, where each is in pool and keys (`Seen`), `NOT_YET` where it is not."""

    place_of: Indices
    pool: Floats
    keys: NDArray[np.uint8]
    number: int = 0

    @staticmethod
    def nothing(num_squares: int) -> Made:
        """Return what is there at first."""
        return Made(np.full(num_squares, NOT_YET, np.int32), np.empty(0, np.float32), np.empty((0, 6), np.uint8))

    def with_room(self, number: int) -> Made:
        """Return the same with room for so many squares."""
        pool, keys = empty_to_keep(number * BLOCK, np.float32), empty_to_keep((number * SIDE, 6), np.uint8)
        pool[: self.pool.size], keys[: len(self.keys)] = self.pool, self.keys
        return Made(self.place_of.copy(), pool, keys, self.number)


@lru_cache(maxsize=16)
def kernel_rays(camera: Camera) -> tuple[Floats, Floats, Floats]:
    """Return the unit rays of all pixels as `kernels.ray_of` takes them; kept for the latest cameras."""
    if not isinstance(camera, Spherical):
        rays = np.moveaxis(pixel_rays(camera), -1, 0).astype(np.float32)
        return np.empty((2, 0), np.float32), np.empty((2, 0), np.float32), np.ascontiguousarray(rays.reshape(3, -1))
    middle = 0.5 * (camera.full_height - 1.0) - camera.offset_v
    along = camera.unproject(np.stack([np.arange(camera.width), np.full(camera.width, middle)], axis=-1))
    up = camera.unproject(np.stack([np.zeros(camera.height), np.arange(camera.height)], axis=-1))
    columns, rows = along[:, :2].T, np.stack([np.hypot(up[:, 0], up[:, 1]), up[:, 2]])
    empty = np.empty((3, 0), np.float32)
    return np.ascontiguousarray(columns, np.float32), np.ascontiguousarray(rows, np.float32), empty


@lru_cache(maxsize=16)
def cones_of(camera: Camera) -> Floats:
    """Return the cone (M, 4) of rays of every square: axis and half angle in rad, -1 where the camera has none."""
    side = kernels.SQUARE
    cones = []
    for row in range(0, camera.height, side):
        height = min(side, camera.height - row)
        v, u = np.mgrid[row : row + height, 0 : -(-camera.width // side) * side]
        rays = camera.unproject(np.stack([np.minimum(u, camera.width - 1), v], axis=-1).astype(np.float64))
        rays = rays.reshape(height, -1, side, 3).transpose(1, 0, 2, 3).reshape(-1, height * side, 3)
        has_ray = ~np.isnan(rays[..., 0])
        total = np.where(has_ray[..., None], rays, 0.0).sum(axis=1)
        axes = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-9)
        cosines = np.where(has_ray, np.einsum("sj,spj->sp", axes, rays), 1.0)
        angles = np.arccos(np.clip(cosines.min(axis=1), -1.0, 1.0)) + SQUARE_MARGIN
        cones.append(np.column_stack([axes, np.where(has_ray.any(axis=1), angles, -1.0)]))
    return np.concatenate(cones).astype(np.float32)


@lru_cache(maxsize=16)
def curve(width: int, height: int) -> Indices:
    """Return the squares of an image in Morton's order: any piece of it is a patch, no band across the image.

    Patches of an image err together, and differ from others; bands are all alike (`correlation.py`).
    """
    row, column = np.mgrid[0 : -(-height // kernels.SQUARE), 0 : -(-width // kernels.SQUARE)]
    code = np.zeros(row.size, np.int64)
    for bit in range(max(row.shape).bit_length()):
        code |= (column.reshape(-1) >> bit & 1) << 2 * bit | (row.reshape(-1) >> bit & 1) << 2 * bit + 1
    return np.argsort(code).astype(np.int32)
