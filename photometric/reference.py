"""An image with range, prepared once so that many images can be aligned with it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from photometric import kernels
from photometric.iteration.kernels import SIDE
from photometric.params import RegistrationParams
from photometric.projection import Floats
from photometric.pyramid import Image, Level, build_pyramid
from photometric.saliency import saliency_rank
from sphere_geometry import SE3, Camera, Spherical
from sphere_geometry.camera import pixel_grid

TILE = 32  # px: pixels are kept tile by tile, so that a block of them lies together


@dataclass(frozen=True)
class ReferenceLevel:
    """The pixels of one level that have a range, tile by tile, as the kernels take them.

    points (3, N) m, intensity (N,) grey levels, gradient (3, N) grey levels per metre, all in the reference frame.
    `known_rank` (N,) is their saliency order where it was computed before.
    """

    camera: Camera
    points: Floats
    intensity: Floats
    gradient: Floats
    known_rank: NDArray[np.int32] | None = None
    selections: dict[tuple[Camera, int], Selection] = field(default_factory=dict, repr=False, compare=False)

    @property
    def num_pixels(self) -> int:
        """How many pixels have a range."""
        return self.intensity.shape[0]

    @cached_property
    def rank(self) -> NDArray[np.int32]:
        """Place (N,) of each pixel in the saliency order, 0 first; sorted when first asked for, its better half."""
        if self.known_rank is not None:
            return self.known_rank
        return saliency_rank(self.points, self.gradient, limit=self.num_pixels // 2)

    @cached_property
    def bounds(self) -> Floats:
        """Centre and radius (M, 4) in m of the sphere around each `SIDE` pixels."""
        bounds = np.empty((-(-self.num_pixels // SIDE), 4), np.float32)
        kernels.bound_blocks(self.points, bounds)
        return bounds

    def complete(self) -> None:
        """Compute now what is otherwise computed when first asked for."""
        _ = self.rank, self.bounds

    def most_salient(self, number: int) -> ReferenceLevel:
        """Return the level reduced to the best pixels of the saliency order (M15 section 3.6), at most half of all."""
        index = np.flatnonzero(self.rank < number)
        points = np.ascontiguousarray(self.points[:, index])
        gradient = np.ascontiguousarray(self.gradient[:, index])
        return ReferenceLevel(self.camera, points, self.intensity[index], gradient, self.rank[index])


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
    image: Image, range_m: NDArray[np.floating], camera: Camera, params: RegistrationParams | None = None
) -> Reference:
    """Prepare a grey image (H, W) with range along the ray (H, W) in metres, NaN unknown, +Inf far.

    Raises ValueError for sizes that differ and ranges that are zero or negative.
    """
    params = params or RegistrationParams()
    check_range(range_m, camera)
    pyramid = build_pyramid(image.astype(np.float32, copy=False), camera, params.pyramid)
    ranges = np.ascontiguousarray(range_m, dtype=np.float32)
    levels = []
    for index, level in enumerate(pyramid.levels):
        if index:
            ranges = _halve_range(ranges, params.surface_ratio)
        if index < min(params.pyramid.finest, len(pyramid.levels) - 1):
            continue  # no image will be aligned that finely
        levels.append(prepare_level(level, ranges, params.far))
    return Reference(tuple(levels))


def check_range(range_m: NDArray[np.floating], camera: Camera) -> None:
    """Raise ValueError unless the range image has the camera's size and no range is zero or negative."""
    if range_m.shape != (camera.height, camera.width):
        raise ValueError(f"range: expected {camera.width} x {camera.height}, found shape {range_m.shape}")
    if np.nanmin(range_m, initial=np.inf) <= 0:
        raise ValueError(f"range: expected positive, NaN or +Inf, found {np.nanmin(range_m)}")


@lru_cache(maxsize=16)
def rays_of(camera: Camera) -> Floats:
    """Return the unit rays (3, H W) of all pixels, NaN where the camera has none; kept for the latest cameras."""
    rays = camera.unproject(pixel_grid(camera)).astype(np.float32)
    return np.ascontiguousarray(rays.reshape(-1, 3).T)


@lru_cache(maxsize=16)
def tile_order(height: int, width: int) -> NDArray[np.int64]:
    """Return the indices (H W,) of all pixels, tile by tile."""
    v, u = np.mgrid[0:height, 0:width]
    tile = (v // TILE * -(-width // TILE) + u // TILE).reshape(-1)
    return np.argsort(tile, kind="stable")


def _halve_range(range_m: Floats, surface_ratio: float) -> Floats:
    out = np.empty((range_m.shape[0] // 2, range_m.shape[1] // 2), np.float32)
    kernels.halve_range(range_m, np.float32(surface_ratio), out)
    return out


def prepare_level(level: Level, range_m: Floats, far: float) -> ReferenceLevel:
    """Prepare the pixels of one level that have a range."""
    usable = ~np.isnan(range_m)
    usable[[0, -1]] = False  # no central difference there
    if not level.pad:
        usable[:, [0, -1]] = False
    rays = rays_of(level.camera)
    if not isinstance(level.camera, Spherical):
        usable &= ~np.isnan(rays[0]).reshape(usable.shape)
    order = tile_order(*usable.shape)
    index = order[usable.reshape(-1)[order]]
    points = np.empty((3, index.size), np.float32)
    gradient = np.empty((3, index.size), np.float32)
    intensity = np.empty(index.size, np.float32)
    image = level.image.astype(np.float32, copy=False)
    inputs = (index, rays, range_m.reshape(-1), np.float32(far), image, level.pad, level.kernel_camera)
    kernels.reference_points(*inputs, points, intensity, gradient)
    return ReferenceLevel(level.camera, points, intensity, gradient)
