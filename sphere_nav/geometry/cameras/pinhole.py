"""Perspective camera with rational radial and tangential distortion (ROS `plumb_bob`, `rational_polynomial`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.camera import DERIVATIVE_STEP, NEWTON_STEPS, Focal, inside

NUM_DISTORTION = 8  # k1 k2 p1 p2 k3 k4 k5 k6, the order of OpenCV and ROS
MIN_DEPTH = 1e-6


class PlaneCamera(Focal):
    """A camera whose rays meet a plane, where its lens distorts them. Optical frame: z forward, x right, y down."""

    model: ClassVar[str]
    distortion: tuple[float, ...] = ()
    most_distortion: ClassVar[int] = 0  # coefficients

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.distortion) > self.most_distortion or not np.all(np.isfinite(self.distortion)):
            expected = f"expected up to {self.most_distortion} finite numbers"
            raise ValueError(f"distortion: {expected}, found {self.distortion}")

    @cached_property
    def coefficients(self) -> Array:
        """(fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, largest squared radius)."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self._padded, self.max_radius**2])

    @property
    def _padded(self) -> tuple[float, ...]:
        return (*self.distortion, *(0.0,) * (NUM_DISTORTION - len(self.distortion)))

    @property
    def is_distorted(self) -> bool:
        """Whether any distortion coefficient is not zero."""
        return any(self.distortion)

    @cached_property
    def max_radius(self) -> float:
        """Largest undistorted radius on the plane up to which the radial distortion grows monotonically.

        Beyond it the polynomial folds back and would project points from far outside into the image.
        """
        if not self.is_distorted:
            return np.inf
        r = np.linspace(0.0, 10.0, 4001)
        numerator, denominator = self._fraction(r * r)
        distorted = np.where(denominator > 0, r * numerator / np.where(denominator > 0, denominator, 1.0), -1.0)
        falling = np.flatnonzero(np.diff(distorted) <= 0)
        return float(r[max(falling[0] - 1, 0)]) if falling.size else np.inf

    def depths(self, points: Array) -> Array:
        """Return what x and y of points (..., 3) are divided by to lie on the plane (...); NaN where none can."""
        z = points[..., 2]
        return np.where(z > MIN_DEPTH, z, np.nan)

    def rays(self, plane: Array) -> Array:
        """Return the unit rays (..., 3) to undistorted places (..., 2) of the plane; NaN where there is none."""
        rays: Array = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        return rays

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3); those without a place on the plane, or beyond `max_radius`, are NaN, not visible."""
        p = np.asarray(points, dtype=np.float64)
        xy = p[..., :2] / self.depths(p)[..., None]
        xy = np.where((np.sum(xy * xy, axis=-1) <= self.max_radius**2)[..., None], xy, np.nan)
        pixels = self._distort(xy) * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels, inside(pixels, self)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3), distortion undone by Newton's method; NaN where it has no solution."""
        xy = (np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)
        return self.rays(self._undistort(xy) if self.is_distorted else xy)

    def _undistort(self, target: Array) -> Array:
        xy = target
        with np.errstate(all="ignore"):  # rays that do not exist run away and are refused below
            for _ in range(NEWTON_STEPS):
                found = self._distort(xy)
                a, b = (self._distort(xy + DERIVATIVE_STEP * axis) - found for axis in np.eye(2))
                error = DERIVATIVE_STEP * (found - target)
                step = np.stack([_determinant(error, b), _determinant(a, error)], axis=-1)
                xy = xy - step / _determinant(a, b)[..., None]
            off = np.linalg.norm(self._distort(xy) - target, axis=-1)
            good = (off < 1e-8) & (np.linalg.norm(xy, axis=-1) <= self.max_radius)
        return np.where(good[..., None], xy, np.nan)

    def _fraction(self, r2: Array) -> tuple[Array, Array]:
        """Return numerator and denominator of the radial distortion at squared radii."""
        k1, k2, _, _, k3, k4, k5, k6 = self._padded
        return 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))

    def _distort(self, xy: Array) -> Array:
        if not self.is_distorted:
            return xy
        x, y = xy[..., 0], xy[..., 1]
        r2, (_, _, p1, p2, *_) = x * x + y * y, self._padded
        numerator, denominator = self._fraction(r2)
        u = x * numerator / denominator + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * numerator / denominator + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([u, v], axis=-1)


@dataclass(frozen=True)
class Pinhole(PlaneCamera):
    """M15 eq. 26."""

    distortion: tuple[float, ...] = ()
    model: ClassVar[str] = "pinhole"
    most_distortion: ClassVar[int] = NUM_DISTORTION


def _determinant(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
