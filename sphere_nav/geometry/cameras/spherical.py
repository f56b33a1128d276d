"""The equirectangular sphere, whole or a window of it (M15 eq. 28-29 in the axes of docs/conventions.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import TINY, Array, Flags
from sphere_nav.geometry.cameras.camera import Camera, check_size, inside


@dataclass(frozen=True)
class Spherical:
    """Body axes: x forward at the centre column, y left, z up. Columns of a whole sphere wrap around.

    A *partial sphere* (what one camera saw of the sphere) stores only a window: `width` x `height` pixels whose
    first pixel is column `offset_u`, row `offset_v` of a whole sphere of `full_width` columns.
    """

    width: int
    height: int
    full_width: float = 0.0  # 0: the window is the whole sphere
    offset_u: float = 0.0
    offset_v: float = 0.0
    model: ClassVar[str] = "spherical"

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        if self.full_width == 0.0:
            object.__setattr__(self, "full_width", float(self.width))
            if self.width != 2 * self.height:
                raise ValueError(f"sphere: expected width = 2 x height, found {self.width} x {self.height}")
        numbers = (self.full_width, self.offset_u, self.offset_v)
        if not np.all(np.isfinite(numbers)) or self.full_width < self.width:
            raise ValueError(f"sphere window: expected at most {self.full_width} columns, found {self.width}")

    @cached_property
    def coefficients(self) -> Array:
        """(full_width, full_height, offset_u, offset_v)."""
        return np.array([self.full_width, self.full_height, self.offset_u, self.offset_v])

    @property
    def full_height(self) -> float:
        """Rows of the whole sphere."""
        return self.full_width / 2.0

    @property
    def is_whole(self) -> bool:
        """Whether the image holds every direction, so that column `width` is column 0."""
        return self.width == self.full_width and self.height == self.full_height

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the equator."""
        return self.full_width / (2.0 * np.pi)

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3); u is in [-1/2, full_width - 1/2) before the window is cut out."""
        p = np.asarray(points, dtype=np.float64)
        horizontal = np.hypot(p[..., 0], p[..., 1])
        defined = horizontal + np.abs(p[..., 2]) > 0
        azimuth = np.where(defined, np.arctan2(p[..., 1], p[..., 0]), np.nan)
        elevation = np.arctan2(p[..., 2], horizontal)
        u = (0.5 - azimuth / (2 * np.pi)) * self.full_width - 0.5 - self.offset_u
        v = (0.5 - elevation / np.pi) * self.full_height - 0.5 - self.offset_v
        u = (u + 0.5) % self.full_width - 0.5
        pixels = np.stack([u, v], axis=-1)
        return pixels, inside(pixels, self) | (defined & self.is_whole)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3) of pixels (..., 2)."""
        q = np.asarray(pixels, dtype=np.float64)
        azimuth = (0.5 - (q[..., 0] + self.offset_u + 0.5) / self.full_width) * 2 * np.pi
        elevation = (0.5 - (q[..., 1] + self.offset_v + 0.5) / self.full_height) * np.pi
        cosine = np.cos(elevation)
        return np.stack([cosine * np.cos(azimuth), cosine * np.sin(azimuth), np.sin(elevation)], axis=-1)

    def J_project(self, points: ArrayLike) -> Array:
        """Return d pixel / d point (..., 2, 3)."""
        p = np.asarray(points, dtype=np.float64)
        x, y, z = p[..., 0], p[..., 1], p[..., 2]
        horizontal2 = np.maximum(x * x + y * y, TINY)
        horizontal = np.sqrt(horizontal2)
        by_azimuth = self.full_width / (2 * np.pi) / horizontal2
        by_elevation = self.full_height / np.pi / ((horizontal2 + z * z) * horizontal)
        J = np.zeros((*p.shape[:-1], 2, 3))
        J[..., 0, 0], J[..., 0, 1] = by_azimuth * y, -by_azimuth * x
        J[..., 1, 0], J[..., 1, 1] = by_elevation * x * z, by_elevation * y * z
        J[..., 1, 2] = -by_elevation * horizontal2
        return J

    def halve(self) -> Self:
        """Return the sphere of the next pyramid level; a whole sphere must have even sides."""
        if self.is_whole and (self.width % 2 or self.height % 2):
            raise ValueError(f"sphere pyramid: expected even sides, found {self.width} x {self.height}")
        full = self.full_width / 2
        return type(self)(self.width // 2, self.height // 2, full, self.offset_u / 2, self.offset_v / 2)


@lru_cache(maxsize=64)
def level_cameras(camera: Camera, min_side: int, num_levels: float = np.inf) -> tuple[Camera, ...]:
    """Return the cameras of all levels, at most so many, from fine to coarse."""
    cameras = [camera]
    while len(cameras) < num_levels and min(camera.width, camera.height) // 2 >= min_side:
        if camera.is_whole and (camera.width % 4 or camera.height % 2):
            break
        camera = camera.halve()
        cameras.append(camera)
    return tuple(cameras)
