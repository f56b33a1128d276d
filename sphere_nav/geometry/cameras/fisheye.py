"""Fisheye camera, Kannala-Brandt with four coefficients (ROS `equidistant`, OpenCV `fisheye`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.camera import NEWTON_STEPS, Focal, inside

MIN_SINE = 1e-9


def polar(p: Array) -> tuple[Array, Array, Array, Array]:
    """Return distance from the axis (at least MIN_SINE), angle from it, and direction about it x, y of points."""
    sine = np.hypot(p[..., 0], p[..., 1])
    on_axis = sine < MIN_SINE
    sine = np.where(on_axis, MIN_SINE, sine)
    x, y = np.where(on_axis, 1.0, p[..., 0] / sine), np.where(on_axis, 0.0, p[..., 1] / sine)
    return sine, np.arctan2(sine, p[..., 2]), x, y


def J_polar(p: Array, where: Sequence[Array], radius: Array, slope: Array) -> Array:
    """Return the derivative (..., 2, 3) of places at image radii by points; `slope`: of the radius by the angle."""
    sine, _, x, y = where
    square = sine * sine + p[..., 2] * p[..., 2]
    along, by_z = slope * p[..., 2] / square, -slope * sine / square
    across = np.where(sine < 1e-7, along, radius / sine)
    J = np.empty((*p.shape[:-1], 2, 3))
    J[..., 0, 0], J[..., 1, 1] = along * x * x + across * y * y, along * y * y + across * x * x
    J[..., 0, 1] = J[..., 1, 0] = (along - across) * x * y
    J[..., 0, 2], J[..., 1, 2] = by_z * x, by_z * y
    return J


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
        """(fx, fy, cx, cy, k1, k2, k3, k4, largest angle from the axis in radians)."""
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
        sine = np.hypot(p[..., 0], p[..., 1])
        angle = np.arctan2(sine, p[..., 2])
        on_axis = sine < MIN_SINE
        valid = (angle <= self.max_angle) & (~on_axis | (p[..., 2] > 0))  # straight behind is a whole circle
        factor = np.where(
            on_axis,
            1.0 / np.where(p[..., 2] > 0, p[..., 2], np.inf),
            self._radius(angle) / np.where(on_axis, 1.0, sine),
        )
        pixels = np.where(valid, factor, np.nan)[..., None] * p[..., :2] * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels, inside(pixels, self)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3); NaN beyond `max_angle`."""
        xy = (np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)
        radius = np.linalg.norm(xy, axis=-1)
        angle = np.minimum(radius, self.max_angle)
        for _ in range(NEWTON_STEPS):
            slope = np.maximum(self._slope(angle), 1e-3)
            angle = np.clip(angle - (self._radius(angle) - radius) / slope, 0.0, self.max_angle)
        angle = np.where(np.abs(self._radius(angle) - radius) < 1e-8, angle, np.nan)
        scale = np.where(radius < MIN_SINE, 1.0, np.sin(angle) / np.where(radius < MIN_SINE, 1.0, radius))
        return np.concatenate([xy * scale[..., None], np.cos(angle)[..., None]], axis=-1)

    def J_project(self, points: ArrayLike) -> Array:
        """Return d pixel / d point (..., 2, 3)."""
        p = np.asarray(points, dtype=np.float64)
        _, angle, _, _ = where = polar(p)
        return np.diag([self.fx, self.fy]) @ J_polar(p, where, self._radius(angle), self._slope(angle))

    def _radius(self, angle: Array) -> Array:
        k1, k2, k3, k4 = self.distortion
        a2 = angle * angle
        return angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))

    def _slope(self, angle: Array) -> Array:
        k1, k2, k3, k4 = self.distortion
        a2 = angle * angle
        return 1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4)))
