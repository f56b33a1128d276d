"""Polynomial camera (Scaramuzza, Martinelli, Siegwart: A Toolbox for Easily Calibrating Omnidirectional Cameras)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.camera import MAX_LENGTH, TABLE, Lens, check_lens, check_size, inside, invert
from sphere_nav.geometry.cameras.fisheye import from_axis

MIN_DETERMINANT = 0.1  # of the affine part, whose axes are nearly at right angles
MAX_DEGREE = 19
FITTED_DEGREE = 12  # of the angle, for kernels: within a thousandth of a pixel; align/iteration/test_kernels


@dataclass(frozen=True)
class OCam(Lens):
    """Optical frame: z forward, x right, y down; OCamCalib, whose own axes are rows, columns, and z from the scene.

    A pixel's offset from the centre is A q with A = ((1, e), (d, c)); q lies on the ray (q, h(|q|)) with
    h(r) = h0 + h1 r + h2 r^2 + ..., in pixels. OCamCalib's polynomial is -h.
    """

    width: int
    height: int
    cx: float
    cy: float
    polynomial: tuple[float, ...]
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0
    model: ClassVar[str] = "ocam"

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        if not 1 <= len(self.polynomial) <= MAX_DEGREE + 1 or not np.all(np.isfinite(self.polynomial)):
            raise ValueError(
                f"ocam: polynomial: expected 1 to {MAX_DEGREE + 1} finite numbers, found {self.polynomial}"
            )
        check_lens(self.polynomial[0], self.polynomial[0], self.cx, self.cy)
        if not (
            abs(self.c - self.d * self.e) > MIN_DETERMINANT and max(map(abs, (self.c, self.d, self.e))) < MAX_LENGTH
        ):
            raise ValueError(f"ocam: affine part: expected c - d e away from 0, found {self.c}, {self.d}, {self.e}")

    @cached_property
    def coefficients(self) -> Array:
        """(f, f c, cx, cy, f e, f d, largest angle, 1, then radius by f and angle as a polynomial of the angle).

        f in px by the angle on the axis.
        """
        f, radii = self.polynomial[0], np.linspace(0.0, self._max_radius, TABLE)[1:]
        angles = self._angle(radii)
        by_angle = poly.Polynomial.fit(angles, radii / (f * angles), FITTED_DEGREE).convert().coef
        affine = f, f * self.c, self.cx, self.cy, f * self.e, f * self.d
        return np.array([*affine, self.max_angle, 1.0, *by_angle])

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the optical axis."""
        return float(self.polynomial[0] * np.sqrt(abs(self.c - self.d * self.e)))

    @property
    def max_angle(self) -> float:
        """Largest angle from the axis up to which the image radius grows, as far as the image reaches."""
        return float(self._angle(np.array(self._max_radius)))

    @cached_property
    def _max_radius(self) -> float:
        """Radius of the farthest corner of the image, or where the angle no longer grows."""
        corners = np.array([[u, v] for u in (-0.5, self.width - 0.5) for v in (-0.5, self.height - 0.5)])
        farthest = float(np.linalg.norm(self._offset(corners), axis=-1).max())
        radii = np.linspace(0.0, farthest, TABLE)
        falling = np.flatnonzero(np.diff(self._angle(radii)) <= 0)
        return float(radii[falling[0]]) if falling.size else farthest

    def _angle(self, radius: Array) -> Array:
        angle: Array = np.arctan2(radius, poly.polyval(radius, self.polynomial))
        return angle

    def _radius(self, angle: Array) -> Array:
        return invert(self._angle, self._max_radius, angle)

    @property
    def _affine(self) -> Array:
        return np.array([[1.0, self.e], [self.d, self.c]])

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3); points beyond `max_angle`, or straight behind, are NaN and not visible."""
        angle, direction = from_axis(points, self.max_angle)
        pixels = (self._radius(angle)[..., None] * direction) @ self._affine.T + (self.cx, self.cy)
        return pixels, inside(pixels, self)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3); NaN beyond the radius up to which the angle grows."""
        q = self._offset(np.asarray(pixels, dtype=np.float64))
        radius = np.linalg.norm(q, axis=-1)
        height = np.where(radius <= self._max_radius, poly.polyval(radius, self.polynomial), np.nan)
        ray = np.concatenate([q, height[..., None]], axis=-1)
        unit: Array = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        return unit

    def scaled(self, factor: float) -> Self:
        """Return the camera whose image is magnified about its centre, in an image of the same size."""
        scaled = tuple(value * factor ** (1 - power) for power, value in enumerate(self.polynomial))
        return replace(self, polynomial=scaled)

    def _offset(self, pixels: Array) -> Array:
        offset: Array = (pixels - (self.cx, self.cy)) @ np.linalg.inv(self._affine).T
        return offset
