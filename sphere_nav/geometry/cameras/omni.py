"""Mei's camera with distortion (Mei, Rives: Single View Point Omnidirectional Camera Calibration, ICRA 2007)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.camera import Focal
from sphere_nav.geometry.cameras.double_sphere import from_sphere
from sphere_nav.geometry.cameras.pinhole import Pinhole

MAX_XI = 1e3  # a mirror's is 1 at most, a fisheye's 1 to 3


@dataclass(frozen=True)
class Omni(Focal):
    """Optical frame: z forward, x right, y down; Kalibr's `omni` with `radtan`, OpenCV's `omnidir`.

    A point goes to the unit sphere, from there by a distorted pinhole whose centre lies `xi` behind the sphere's:
    (x, y) / (z + xi d), then k1 k2 p1 p2 [k3] and fx fy cx cy. xi = 0 is the pinhole camera.
    """

    xi: float = 0.0
    distortion: tuple[float, ...] = ()
    model: ClassVar[str] = "omni"

    def __post_init__(self) -> None:
        if not 0.0 <= self.xi <= MAX_XI:
            raise ValueError(f"omni: xi: expected 0 to {MAX_XI:g}, found {self.xi}")
        if len(self.distortion) > 5:
            raise ValueError(f"omni: distortion: expected up to 5 numbers, found {len(self.distortion)}")
        self._plane.coefficients.flags.writeable = False  # made here, so that a bad lens is refused at once

    @cached_property
    def _plane(self) -> Pinhole:
        return Pinhole(self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.distortion)

    @cached_property
    def coefficients(self) -> Array:
        """Those of the pinhole (13), xi, 0, and the least cosines seen from both centres (`DoubleSphere`)."""
        return np.array([*self._plane.coefficients[:12], self.max_radius**2, self.xi, 0.0, self.min_cosine, -2.0])

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the optical axis."""
        return super().pixels_per_radian / (1.0 + self.xi)

    @cached_property
    def max_radius(self) -> float:
        """Largest undistorted radius on the plane that has a ray of its own: of distortion, and of the sphere's rim.

        For xi > 1 the plane's radius grows up to z = -d / xi, where it is 1 / sqrt(xi^2 - 1), and falls beyond.
        """
        rim = 1.0 / np.sqrt(self.xi**2 - 1.0) if self.xi > 1.0 else np.inf
        return float(min(rim, self._plane.max_radius))

    @property
    def min_cosine(self) -> float:
        """Cosine of the largest angle from the axis that has a pixel."""
        return -self.xi if self.xi <= 1.0 else -1.0 / self.xi

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3); points beyond the largest angle are NaN and not visible."""
        p = np.asarray(points, dtype=np.float64)
        distance = np.linalg.norm(p, axis=-1)
        valid = p[..., 2] > self.min_cosine * distance
        shifted = p + (self.xi * distance)[..., None] * np.array([0.0, 0.0, 1.0])
        return self._plane.project(np.where(valid[..., None], shifted, np.nan))

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3); NaN where the model has no ray."""
        ray = self._plane.unproject(pixels)
        return from_sphere(ray[..., :2] / ray[..., 2:], 1.0, self.xi)
