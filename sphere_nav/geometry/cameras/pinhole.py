"""Cameras whose image is a plane: perspective (ROS `plumb_bob`, `rational_polynomial`), or a fisheye.

The latter is Kannala-Brandt with four coefficients (ROS `equidistant`, OpenCV `fisheye`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import TINY, Array, Flags
from sphere_nav.geometry.cameras.camera import check_size, inside

NUM_DISTORTION = 8  # k1 k2 p1 p2 k3 k4 k5 k6, the order of OpenCV and ROS
MIN_DEPTH = 1e-6
MAX_LENGTH = 1e7  # px; of a focal length, and of the centre of a window far from the axis
WIDEST, NUM_RADII = 10.0, 4001  # undistorted radii at which the distortion is known before it is undone
NEWTON_STEPS, ROUNDING = 12, 1e-13  # that undo a distortion, at most, where it can be undone; of the last, on the plane
DERIVATIVE_STEP = 1e-7  # of the range, by which a point is moved; cameras/test_camera


@dataclass(frozen=True)
class PlaneCamera:
    """A camera whose rays meet a plane, where its lens distorts them. Optical frame: z forward, x right, y down.

    Focal lengths and centre are in pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    is_whole = False
    model: ClassVar[str]
    num_distortion: ClassVar[tuple[int, int]] = (0, 0)  # coefficients, at least and at most

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        if not (0 < self.fx <= MAX_LENGTH and 0 < self.fy <= MAX_LENGTH):  # K = 0 says 'uncalibrated'
            expected = "expected positive fx, fy (calibrated camera)"
            raise ValueError(f"focal length: {expected}, found {self.fx}, {self.fy}")
        if not (abs(self.cx) <= MAX_LENGTH and abs(self.cy) <= MAX_LENGTH):
            raise ValueError(f"centre: expected finite cx, cy within {MAX_LENGTH:g} px, found {self.cx}, {self.cy}")
        least, most = self.num_distortion
        if not least <= len(self.distortion) <= most or not np.all(np.isfinite(self.distortion)):
            expected = f"expected {'up to ' if least < most else ''}{most} finite numbers"
            raise ValueError(f"distortion: {expected}, found {self.distortion}")

    @property
    def distortion(self) -> tuple[float, ...]:
        """Coefficients in the order of the model; none of a model without."""
        return ()

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

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the optical axis."""
        return float(np.sqrt(self.fx * self.fy))

    @cached_property
    def max_radius(self) -> float:
        """Largest undistorted radius on the plane up to which the radial distortion grows monotonically.

        Beyond it the polynomial folds back and would project points from far outside into the image.
        """
        r = np.linspace(0.0, WIDEST, NUM_RADII)
        falling = np.flatnonzero(~(np.diff(r * self._stretch(r * r)) > 0.0))
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
        pixels = (self._distort(xy) if self.is_distorted else xy) * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels, inside(pixels, self)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3), distortion undone by Newton's method; NaN where it has no solution."""
        xy = (np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)
        return self.rays(self._undistort(xy) if self.is_distorted else xy)

    def J_project(self, points: ArrayLike) -> Array:
        """Return d pixel / d point (..., 2, 3), by differences; each step is towards the axis, where there are rays."""
        p = np.asarray(points, dtype=np.float64)
        pixels, step = self.project(p)[0], DERIVATIVE_STEP * np.linalg.norm(p, axis=-1)
        columns = []
        for axis, direction in enumerate(np.eye(3)):
            inwards = np.where((axis < 2) & (p[..., axis] > 0.0), -step, step)[..., None]
            columns.append((self.project(p + inwards * direction)[0] - pixels) / inwards)
        return np.stack(columns, axis=-1)

    def scaled(self, factor: float) -> Self:
        """Return the camera whose image is magnified about its centre, in an image of the same size."""
        return replace(self, fx=self.fx * factor, fy=self.fy * factor)

    def halve(self) -> Self:
        """Return the camera of the next pyramid level."""
        cx, cy = (self.cx + 0.5) / 2 - 0.5, (self.cy + 0.5) / 2 - 0.5
        return replace(self.scaled(0.5), width=self.width // 2, height=self.height // 2, cx=cx, cy=cy)

    def _undistort(self, target: Array) -> Array:
        r = np.linspace(0.0, min(self.max_radius, WIDEST), NUM_RADII)
        radius = np.linalg.norm(target, axis=-1, keepdims=True)
        with np.errstate(all="ignore"):  # rays that do not exist run away and are refused below
            xy = target * np.where(radius > 0.0, np.interp(radius, r * self._stretch(r * r), r) / radius, 1.0)
            for _ in range(NEWTON_STEPS):
                found = self._distort(xy)
                a, b = (self._distort(xy + DERIVATIVE_STEP * axis) - found for axis in np.eye(2))
                error = DERIVATIVE_STEP * (found - target)
                step = np.stack([_determinant(error, b), _determinant(a, error)], axis=-1)
                step = step / _determinant(a, b)[..., None]
                xy = xy - step
                if not np.any(np.abs(step) > ROUNDING):
                    break
            off = np.linalg.norm(self._distort(xy) - target, axis=-1)
            good = (off < 1e-8) & (np.linalg.norm(xy, axis=-1) <= self.max_radius)
        return np.where(good[..., None], xy, np.nan)

    def _stretch(self, r2: Array) -> Array:
        """Return by what the radial distortion multiplies radii, at their squares; NaN where it has a pole."""
        k1, k2, _, _, k3, k4, k5, k6 = self._padded
        divisor = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        return (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / np.where(divisor > 0, divisor, np.nan)

    def _distort(self, xy: Array) -> Array:
        x, y = xy[..., 0], xy[..., 1]
        r2, (_, _, p1, p2, *_) = x * x + y * y, self._padded
        stretch = self._stretch(r2)
        u = x * stretch + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * stretch + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([u, v], axis=-1)


@dataclass(frozen=True)
class Pinhole(PlaneCamera):
    """M15 eq. 26."""

    distortion: tuple[float, ...] = ()
    model: ClassVar[str] = "pinhole"
    num_distortion: ClassVar[tuple[int, int]] = (0, NUM_DISTORTION)


def _determinant(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@dataclass(frozen=True)
class Fisheye(PlaneCamera):
    """A direction lies on the plane as far from the centre as its angle a from the axis, in radians.

    The image radius is f (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9).
    """

    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    model: ClassVar[str] = "fisheye"
    num_distortion: ClassVar[tuple[int, int]] = (4, 4)

    @cached_property
    def coefficients(self) -> Array:
        """(fx, fy, cx, cy, k1, k2, k3, k4, largest angle in radians)."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion, self.max_radius])

    @cached_property
    def max_radius(self) -> float:
        """Largest angle from the axis, up to pi, up to which the image radius grows monotonically."""
        return float(min(np.pi, super().max_radius))

    def depths(self, points: Array) -> Array:
        """Return what x and y of points (..., 3) are divided by to be as long as the angle is; NaN straight behind."""
        sine = np.maximum(np.hypot(points[..., 0], points[..., 1]), TINY)
        is_one_place = (sine > TINY) | (points[..., 2] > 0)  # straight behind is a whole circle
        return np.where(is_one_place, sine / np.arctan2(sine, points[..., 2]), np.nan)

    def rays(self, plane: Array) -> Array:
        """Return the unit rays (..., 3) to places (..., 2) of the plane; NaN beyond the largest angle."""
        radius = np.linalg.norm(plane, axis=-1, keepdims=True)
        angle = np.where(radius <= self.max_radius, radius, np.nan)
        return np.concatenate([plane * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)

    def _stretch(self, r2: Array) -> Array:
        k1, k2, k3, k4 = self.distortion
        return 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))

    def _distort(self, xy: Array) -> Array:
        return xy * self._stretch(np.sum(xy * xy, axis=-1, keepdims=True))
