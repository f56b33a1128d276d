"""Fisheye camera, Kannala-Brandt with four coefficients (ROS `equidistant`, OpenCV `fisheye`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.camera import DERIVATIVE_STEP, NEWTON_STEPS, Focal, inside

MIN_SINE = 1e-9
TABLE = 2000  # angles at which the radius is known, between which it is inverted
FLATTEST, ROUNDING = 1e-3, 1e-14  # of the mean slope, before it folds back; of the largest angle, a step that is last


@dataclass(frozen=True)
class Fisheye(Focal):
    """Optical frame: z forward, x right, y down; the image radius is f (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9)."""

    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    model: ClassVar[str] = "fisheye"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.distortion) != 4 or not np.all(np.isfinite(self.distortion)):
            raise ValueError(f"distortion: expected 4 finite numbers, found {self.distortion}")

    @cached_property
    def coefficients(self) -> Array:
        """(fx, fy, cx, cy, k1, k2, k3, k4, largest angle in radians)."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion, self.max_angle])

    @cached_property
    def max_angle(self) -> float:
        """Largest angle from the axis, up to pi, up to which the image radius grows monotonically."""
        angle = np.linspace(0.0, np.pi, 3001)
        falling = np.flatnonzero(np.diff(self._radius(angle)) <= 0)
        return float(angle[max(falling[0] - 1, 0)]) if falling.size else float(np.pi)

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3); points beyond `max_angle`, or straight behind, are NaN and not visible."""
        p = np.asarray(points, dtype=np.float64)
        sine = np.maximum(np.hypot(p[..., 0], p[..., 1]), MIN_SINE)
        angle = np.arctan2(sine, p[..., 2])
        valid = (angle <= self.max_angle) & ((sine > MIN_SINE) | (p[..., 2] > 0))  # straight behind is a whole circle
        radius = self._radius(np.where(valid, angle, np.nan))[..., None]
        pixels = radius * (p[..., :2] / sine[..., None]) * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels, inside(pixels, self)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3); NaN beyond `max_angle`."""
        xy = (np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)
        radius = np.linalg.norm(xy, axis=-1)
        angle = self._angle(radius)
        angle = np.where(np.abs(self._radius(angle) - radius) < 1e-8, angle, np.nan)
        scale = np.where(radius < MIN_SINE, 1.0, np.sin(angle) / np.where(radius < MIN_SINE, 1.0, radius))
        return np.concatenate([xy * scale[..., None], np.cos(angle)[..., None]], axis=-1)

    def _angle(self, radius: Array) -> Array:
        """Return the angle, up to `max_angle`, that comes closest to a radius (...): by a table, then to rounding."""
        high = self.max_angle
        grid = np.linspace(0.0, high, TABLE)
        table, step = self._radius(grid), DERIVATIVE_STEP * high
        angle = np.interp(radius, table, grid)
        for _ in range(NEWTON_STEPS):
            found, before = self._radius(angle), angle
            slope = np.maximum((found - self._radius(angle - step)) / step, FLATTEST * table[-1] / high)
            angle = np.clip(angle - (found - radius) / slope, 0.0, high)
            if not np.any(np.abs(angle - before) > ROUNDING * high):
                break
        return angle

    def _radius(self, angle: Array) -> Array:
        k1, k2, k3, k4 = self.distortion
        a2 = angle * angle
        return angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
