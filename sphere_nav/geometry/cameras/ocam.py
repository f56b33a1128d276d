"""Polynomial camera (Scaramuzza, Martinelli, Siegwart: A Toolbox for Easily Calibrating Omnidirectional Cameras)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.camera import MAX_LENGTH, NEWTON_STEPS, check_lens, check_size, inside
from sphere_nav.geometry.cameras.fisheye import MIN_SINE, J_polar, polar

MIN_DETERMINANT = 0.1  # of the affine part, whose axes are nearly at right angles
TABLE = 2000  # radii of the table that Newton's method starts from
MAX_DEGREE = 19


@dataclass(frozen=True)
class OCam:
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
        """(f, f c, cx, cy, c, d, e, largest angle, then the polynomial); f in px by the angle on the axis."""
        f = self.polynomial[0]
        return np.array([f, f * self.c, self.cx, self.cy, self.c, self.d, self.e, self.max_angle, *self.polynomial])

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the optical axis."""
        return float(self.polynomial[0] * np.sqrt(abs(self.c - self.d * self.e)))

    @property
    def max_angle(self) -> float:
        """Largest angle from the axis up to which the image radius grows, as far as the image reaches."""
        return float(self._angles[-1])

    @cached_property
    def _radii(self) -> Array:
        """Radii (K,) from 0 to the farthest corner of the image, or to where the angle no longer grows."""
        corners = np.array([[u, v] for u in (-0.5, self.width - 0.5) for v in (-0.5, self.height - 0.5)])
        farthest = float(np.linalg.norm(self._offset(corners), axis=-1).max())
        radii: Array = np.linspace(0.0, farthest, TABLE)
        angles = np.arctan2(radii, poly.polyval(radii, self.polynomial))
        falling = np.flatnonzero(np.diff(angles) <= 0)
        return radii[: falling[0] + 1] if falling.size else radii

    @cached_property
    def _angles(self) -> Array:
        angles: Array = np.arctan2(self._radii, poly.polyval(self._radii, self.polynomial))
        return angles

    @property
    def _affine(self) -> Array:
        return np.array([[1.0, self.e], [self.d, self.c]])

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3); points beyond `max_angle`, or straight behind, are NaN and not visible."""
        p = np.asarray(points, dtype=np.float64)
        sine, angle, _, _ = polar(p)
        valid = (angle <= self.max_angle) & ((sine > MIN_SINE) | (p[..., 2] > 0))
        direction = p[..., :2] / sine[..., None]
        q = np.where(valid, self._radius(angle), np.nan)[..., None] * direction
        pixels = q @ self._affine.T + (self.cx, self.cy)
        return pixels, inside(pixels, self)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3); NaN beyond the radius up to which the angle grows."""
        q = self._offset(np.asarray(pixels, dtype=np.float64))
        radius = np.linalg.norm(q, axis=-1)
        height = np.where(radius <= self._radii[-1], poly.polyval(radius, self.polynomial), np.nan)
        ray = np.concatenate([q, height[..., None]], axis=-1)
        unit: Array = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        return unit

    def J_project(self, points: ArrayLike) -> Array:
        """Return d pixel / d point (..., 2, 3)."""
        p = np.asarray(points, dtype=np.float64)
        _, angle, _, _ = where = polar(p)
        radius = self._radius(angle)
        return self._affine @ J_polar(p, where, radius, 1.0 / self._slope(radius))

    def halve(self) -> Self:
        """Return the camera of the next pyramid level, whose radii are half as long."""
        cx, cy = (self.cx + 0.5) / 2 - 0.5, (self.cy + 0.5) / 2 - 0.5
        return replace(self.scaled(0.5), width=self.width // 2, height=self.height // 2, cx=cx, cy=cy)

    def scaled(self, factor: float) -> Self:
        """Return the camera whose image is magnified about its centre, in an image of the same size."""
        scaled = tuple(value * factor ** (1 - power) for power, value in enumerate(self.polynomial))
        return replace(self, polynomial=scaled)

    def _offset(self, pixels: Array) -> Array:
        offset: Array = (pixels - (self.cx, self.cy)) @ np.linalg.inv(self._affine).T
        return offset

    def _radius(self, angle: Array) -> Array:
        """Return image radii of angles up to `max_angle`, from the table to rounding by Newton's method."""
        radius = np.interp(angle, self._angles, self._radii)
        for _ in range(NEWTON_STEPS // 4):
            error = np.arctan2(radius, poly.polyval(radius, self.polynomial)) - angle
            radius = np.clip(radius - error / self._slope(radius), 0.0, self._radii[-1])
        return radius

    def _slope(self, radius: Array) -> Array:
        """Return d angle / d radius."""
        h, by_r = poly.polyval(radius, self.polynomial), poly.polyval(radius, poly.polyder(self.polynomial))
        slope: Array = (h - radius * by_r) / (radius**2 + h**2)
        return slope
