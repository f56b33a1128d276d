"""Fisheye camera, Kannala-Brandt with four coefficients (ROS `equidistant`, OpenCV `fisheye`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.geometry.cameras.pinhole import PlaneCamera


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
