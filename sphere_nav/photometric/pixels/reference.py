"""An image with range, prepared once so that many images can be aligned with it, and the choice of its pixels.

Evenly spaced points on a sphere (P of M15 eq. 9), chosen from the pixels of its image.

Beside a surface that ends, pixels of what is behind it show a part of it, and its edge: by their range the edge would
have moved less than it did. They are left out, all along the way the same error would come with every alignment.

Rows of latitude and longitude have as many pixels at the poles as at the equator: what is above and below counts many
times over, and noise there looks like gradients. Of every row as many are kept as its circle has room for.

A whole sphere has millions of pixels, of which one camera sees some per cent: squares of them are made into points and
gradients when a camera first sees them. What is chosen does not depend on which squares were made before. A camera that
turns leaves squares behind; they are forgotten when they are a quarter as many as those that it sees. Several threads
may ask: what one was given is never changed.

At run time the most salient of the pixels that the camera sees are selected, s(.) of eq. 16: salient by algorithm 1,
balanced over the six columns among what is visible: what is best elsewhere says nothing here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from threading import Lock
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import empty_to_keep
from sphere_nav.geometry.cameras.camera import pixel_grid, pixel_rays
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.constants import EDGE_PIXELS, EDGE_SHARE, MAX_SHIFT, MAX_VIEWS, MIN_SQUARES, SQUARE_MARGIN
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels import kernels
from sphere_nav.photometric.pixels.pyramid import (
    Floats,
    Image,
    Level,
    check_image,
    halve,
    kernel_camera,
    kernel_motion,
    level_cameras,
    pad_of,
    view_cone,
)

Indices = NDArray[np.int32]
Steps = NDArray[np.uint16]
GROWTH = 0.125  # of the room that is made beyond what is needed
NOT_YET = -1


class Seen(NamedTuple):
    """Squares that a camera may see: places (K,) in `pool` (S * BLOCK,) and `keys` (S * SIDE, 6) of all that are."""

    places: Indices
    pool: Floats
    keys: NDArray[np.uint8]


class ReferenceLevel:
    """Pixels of one level in the frame of the reference, `num_pixels` of them with a range, and what was chosen."""

    def __init__(self, image: Steps, camera: Camera, pad: int, ranges: Steps, far: float) -> None:
        """An image and its ranges (H, W) as `kernels.quantize` and `kernels.encode_range` make them; +Inf: `far` m."""
        self.camera, self._ranges, self._far = camera, ranges, np.float32(far)
        self._image, self._pad, self._lock = image, pad, Lock()
        cones, self._order = cones_of(camera), curve(camera.width, camera.height)
        self.bounds = empty_to_keep((len(cones), 4), np.float32)
        self.num_pixels = int(kernels.bound_squares(ranges, kernels.RANGES, self._far, pad, cones, self.bounds))
        self._own_bytes = image.nbytes + ranges.nbytes + self.bounds.nbytes
        self._made = Made.nothing(len(cones))
        self.selections: dict[tuple[Camera, int], Selection] = {}

    @property
    def num_bytes(self) -> int:
        """Memory that the level takes now."""
        chosen = sum(one.blocks.nbytes for one in list(self.selections.values()))
        return self._own_bytes + self._made.pool.nbytes + self._made.keys.nbytes + chosen

    @property
    def points(self) -> Floats:
        """Points (3, N) in m of all pixels, square by square."""
        return self.pixels[:3]

    @property
    def intensity(self) -> Floats:
        """Grey levels (N,) of all pixels."""
        return self.pixels[3]

    @property
    def gradient(self) -> Floats:
        """Gradients (3, N) by the point of all pixels, in grey levels per metre."""
        return self.pixels[4:]

    @cached_property
    def pixels(self) -> Floats:
        """Points, grey levels and gradients (7, N) of all pixels, square by square."""
        return pixels_of(self.all())

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

    Patches of an image err together, and differ from others; bands are all alike (`align/esm.py`).
    """
    row, column = np.mgrid[0 : -(-height // kernels.SQUARE), 0 : -(-width // kernels.SQUARE)]
    code = np.zeros(row.size, np.int64)
    for bit in range(max(row.shape).bit_length()):
        code |= (column.reshape(-1) >> bit & 1) << 2 * bit | (row.reshape(-1) >> bit & 1) << 2 * bit + 1
    return np.argsort(code).astype(np.int32)


GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0  # of a pixel, by which a row begins after the one above it


def keep_evenly_spaced(ranges: NDArray[np.uint16], camera: Camera) -> None:
    """Forget the ranges (H, W), codes of `kernels.encode_range`, of pixels that a sphere is not sampled at."""
    if isinstance(camera, Spherical):
        ranges |= np.subtract(is_spaced(camera).view(np.uint8), 1, dtype=np.uint16)  # 0 - 1 is all bits: UNKNOWN


@lru_cache(maxsize=16)
def is_spaced(camera: Spherical) -> NDArray[np.bool_]:
    """Return which pixels (H, W) are as far from each other along their row as neighbours at the equator."""
    cosine = np.sqrt(1.0 - camera.unproject(pixel_grid(camera)[:, :1])[..., 2] ** 2)
    first = GOLDEN * np.arange(camera.height)[:, None] % 1.0
    number = np.floor(first + cosine * np.arange(camera.width + 1))  # of those kept before a column
    return np.diff(number, axis=1) > 0


def pixels_of(seen: Seen) -> Floats:
    """Return points in m, grey levels and gradients (7, N) of some squares."""
    rows = seen.pool.reshape(-1, BLOCK // SIDE, SIDE)[seen.places]
    pixels = rows.transpose(1, 0, 2).reshape(BLOCK // SIDE, -1)
    return np.ascontiguousarray(pixels[:, ~np.isnan(pixels[2])])


@dataclass(frozen=True)
class Selection:
    """Pixels chosen for a camera at a pose: blocks for the kernels, their number, their harmonic mean range in m."""

    T_camera_reference: SE3
    blocks: Floats
    num_pixels: int
    typical_range: float


@dataclass(frozen=True)
class Reference:
    """An augmented image (M15 section 2.1) on all levels that are used, from fine to coarse."""

    levels: tuple[ReferenceLevel, ...]

    @property
    def camera(self) -> Camera:
        """The camera of the finest level."""
        return self.levels[0].camera

    @property
    def num_bytes(self) -> int:
        """Memory that it takes now; it grows with what cameras see of it."""
        return sum(level.num_bytes for level in self.levels)

    def level_like(self, camera: Camera) -> ReferenceLevel:
        """Return the level whose angular resolution is nearest to a camera's."""
        index = round(math.log2(self.camera.pixels_per_radian / camera.pixels_per_radian))
        return self.levels[min(max(index, 0), len(self.levels) - 1)]


@dataclass(frozen=True)
class View:
    """A reference and where it is; any frame can be `world` as long as all views of a registration share it."""

    reference: Reference
    T_world_reference: SE3


def prepare_reference(
    image: Image,
    range_m: NDArray[np.floating],
    camera: Camera,
    params: RegistrationParams | None = None,
    *,
    keep_edges: bool = False,
) -> Reference:
    """Prepare a grey image (H, W) with range along the ray (H, W) in metres, NaN unknown, +Inf far.

    Of the pixels of a sphere those are used that are evenly spaced on it (M15 eq. 9); of any image none beside a nearer
    surface, but on the coarsest level, which begins an alignment and tells what overlaps. `keep_edges`: those, too, of
    an image so small that little is left without them.

    Raises ValueError for sizes that differ and ranges that are zero or negative.
    """
    params = params or RegistrationParams()
    check_range(range_m, camera)
    image = image if image.dtype == np.uint8 else image.astype(np.float32, copy=False)
    check_image(image, camera)
    cameras = level_cameras(camera, params.pyramid.min_side, params.pyramid.num_levels)
    finest, pad = min(params.pyramid.finest, len(cameras) - 1), pad_of(camera)
    steps, ranges = in_steps(image, pad), np.ascontiguousarray(range_m, dtype=np.float32)
    levels = []
    for index, smaller in enumerate(cameras):
        if index:
            steps = halve(steps, pad, empty_to_keep((smaller.height, smaller.width + 2 * pad), np.uint16))
            ranges = halve_range_image(ranges, params.surface_ratio)
        if index >= finest:  # else no image will be aligned that finely
            codes = in_codes(ranges)
            if index < len(cameras) - 1 and not keep_edges:
                kernels.forget_behind_edges(ranges, EDGE_PIXELS, np.float32(EDGE_SHARE), codes)
            keep_evenly_spaced(codes, smaller)
            levels.append(ReferenceLevel(steps, smaller, pad, codes, params.far))
    return Reference(tuple(levels))


def check_range(range_m: NDArray[np.floating], camera: Camera) -> None:
    """Raise ValueError unless the range image has the camera's size and no range is zero or negative."""
    if range_m.shape != (camera.height, camera.width):
        raise ValueError(f"range: expected {camera.width} x {camera.height}, found shape {range_m.shape}")
    if np.nanmin(range_m, initial=np.inf) <= 0:
        raise ValueError(f"range: expected positive, NaN or +Inf, found {np.nanmin(range_m)}")


def halve_range_image(range_m: Floats, surface_ratio: float) -> Floats:
    """Return the range (H // 2, W // 2) of the next level: that of the nearest surface in each 2 x 2 block."""
    out = np.empty((range_m.shape[0] // 2, range_m.shape[1] // 2), np.float32)
    kernels.halve_range(range_m, np.float32(surface_ratio), out)
    return out


def in_steps(image: Image, pad: int) -> Steps:
    """Return grey levels (H, W) in steps of 1 / 256, padded: half the memory, far below the noise of any camera."""
    out = empty_to_keep((image.shape[0], image.shape[1] + 2 * pad), np.uint16)
    kernels.quantize(np.require(image, requirements=["C", "W"]), pad, out)
    return out


def in_codes(range_m: Floats) -> Steps:
    """Return ranges (H, W) in m in half the memory, within 0.017 %: 1 mm at 6 m."""
    out = empty_to_keep(range_m.shape, np.uint16)
    kernels.encode_range(np.require(range_m, np.float32, ["C", "W"]), out)
    return out


def prepare_level(level: Level, range_m: Floats, far: float) -> ReferenceLevel:
    """Prepare one level of an image with range (H, W) in metres; all its pixels are used that are seen."""
    bare = level.unpadded
    is_unseen = np.isnan(bare)
    if is_unseen.any():  # nor has one beside it a gradient
        beside = cv2.dilate(is_unseen.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
        bare, range_m = np.nan_to_num(bare), np.where(beside, np.float32(np.nan), range_m)
    return ReferenceLevel(in_steps(bare, level.pad), level.camera, level.pad, in_codes(range_m), far)


def choose_pixels(pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int) -> Selection:
    """Return `select`, or the last selection for this camera where it still holds: images of a stream move little."""
    if not holds(pixels, T_camera_reference, camera, number):
        renew_selection(pixels, T_camera_reference, camera, number)
    return pixels.selections[camera, number]


def renew_selection(pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int) -> None:
    """Let `choose_pixels` return the selection at another pose."""
    pixels.selections[camera, number] = select(pixels, T_camera_reference, camera, number)


def holds(
    pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int, max_shift: float = MAX_SHIFT
) -> bool:
    """Say whether the image has moved less than a share of its width since the last selection for this camera."""
    last = pixels.selections.get((camera, number))
    return last is not None and _image_shift(last, T_camera_reference, camera) <= max_shift * camera.width


def select(pixels: ReferenceLevel, T_camera_reference: SE3, camera: Camera, number: int) -> Selection:
    """Return the `number` most salient of the pixels that project into the image, in the order of the reference."""
    squares = pixels.near(T_camera_reference, camera, is_thinned=True)
    T = kernel_motion(T_camera_reference.matrix)
    seen = np.empty(squares.places.size * SIDE, np.int32)
    args = (T, kernel_camera(camera), camera.width, camera.height)
    chosen = seen[: kernels.find_visible(squares.places, squares.pool, *args, seen)]
    if chosen.size > number:
        chosen = kernels.best_of(chosen, squares.keys, number)
    blocks = empty_to_keep(-(-chosen.size // SIDE) * BLOCK, np.float32)
    inverse = kernels.gather(squares.pool, chosen, blocks)
    return Selection(T_camera_reference, blocks, chosen.size, 1.0 / inverse)


def _image_shift(last: Selection, T_camera_reference: SE3, camera: Camera) -> float:
    """Return how far the image has moved since a selection, in pixels: the chord of the turn, and the parallax."""
    off = T_camera_reference.matrix - last.T_camera_reference.matrix
    turn = math.sqrt(0.5 * float(np.vdot(off[:3, :3], off[:3, :3])))
    distance = math.sqrt(float(np.vdot(off[:3, 3], off[:3, 3])))
    return (turn + distance / last.typical_range) * camera.pixels_per_radian
