"""Cameras by two unit spheres, or by one.

Two: Usenko, Demmel, Cremers: The Double Sphere Camera Model, 3DV 2018 (basalt's `ds`). One, Mei's, with distortion:
Mei, Rives: Single View Point Omnidirectional Camera Calibration, ICRA 2007.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.pinhole import PlaneCamera

MAX_XI = 1e3  # of an omni: a mirror's is 1 at most, a fisheye's 1 to 3


class SphereCamera(PlaneCamera):
    """A camera whose rays pass one unit sphere, or two, before they meet the plane.

    A point goes to a unit sphere, to a second one `xi` further along the axis, and from there to the plane by a pinhole
    whose centre is shifted by alpha / (1 - alpha). xi = alpha = 0 is the pinhole camera.
    """

    xi: float
    alpha: float = 0.0

    @cached_property
    def coefficients(self) -> Array:
        """Those of a pinhole (13), xi, alpha, and the least cosines seen from the first centre and the second."""
        return np.array([*super().coefficients, self.xi, self.alpha, self.min_cosine_first, self.min_cosine])

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the optical axis."""
        return super().pixels_per_radian / (1 + self.xi)

    @property
    def min_cosine_first(self) -> float:
        """Cosine of the largest angle, seen from the first centre: for xi > 1 the plane's radius falls beyond."""
        return -1.0 / self.xi if self.xi > 1.0 else -2.0

    @property
    def min_cosine(self) -> float:
        """Cosine of the largest angle, seen from the second centre, that has a pixel of its own (-w1 of the paper).

        The paper's bound on the angle from the first centre (eq. 43) refuses a few degrees that do have one.
        """
        a = self.alpha
        return -(a / (1 - a) if a <= 0.5 else (1 - a) / a)

    @cached_property
    def max_radius(self) -> float:
        """Largest undistorted radius on the plane that has a ray of its own: of distortion, and of the sphere's rim."""
        rim = 1.0 / np.sqrt(self.xi**2 - 1.0) if self.xi > 1.0 else np.inf
        return float(min(rim, super().max_radius))

    def depths(self, points: Array) -> Array:
        """Return what x and y of points (..., 3) are divided by to lie on the plane (...); NaN where none can."""
        distance = np.linalg.norm(points, axis=-1)
        shifted = self.xi * distance + points[..., 2]
        second = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2 + shifted**2)
        divisor = self.alpha * second + (1 - self.alpha) * shifted  # eq. 40 to 42
        is_near = (points[..., 2] > self.min_cosine_first * distance) & (shifted > self.min_cosine * second)
        return np.where(is_near, divisor, np.nan)

    def rays(self, plane: Array) -> Array:
        """Return the unit rays (..., 3) to undistorted places (..., 2) of the plane; NaN where there is none."""
        r2, a, xi = np.sum(plane * plane, axis=-1), self.alpha, self.xi
        with np.errstate(invalid="ignore"):
            z = (1 - a * a * r2) / (a * np.sqrt(1 - (2 * a - 1) * r2) + 1 - a)
            scale = (z * xi + np.sqrt(z * z + (1 - xi * xi) * r2)) / (z * z + r2)
        return np.concatenate([scale[..., None] * plane, (scale * z - xi)[..., None]], axis=-1)


@dataclass(frozen=True)
class DoubleSphere(SphereCamera):
    """Wide fisheyes in closed form."""

    xi: float = 0.0
    alpha: float = 0.0
    model: ClassVar[str] = "double_sphere"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (-1.0 < self.xi <= 1.0 and 0.0 <= self.alpha <= 1.0):
            raise ValueError(
                f"double sphere: expected -1 < xi <= 1 and 0 <= alpha <= 1, found xi {self.xi}, alpha {self.alpha}"
            )


@dataclass(frozen=True)
class Omni(SphereCamera):
    """Kalibr's `omni` with `radtan`, OpenCV's `omnidir`: one sphere, and a lens.

    (x, y) / (z + xi d), then k1 k2 p1 p2 [k3] and fx fy cx cy. xi = 0 is the pinhole camera.
    """

    xi: float = 0.0
    distortion: tuple[float, ...] = ()
    model: ClassVar[str] = "omni"
    num_distortion: ClassVar[tuple[int, int]] = (0, 5)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.xi <= MAX_XI:
            raise ValueError(f"omni: xi: expected 0 to {MAX_XI:g}, found {self.xi}")
