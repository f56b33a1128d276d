"""Double-sphere camera (Usenko, Demmel, Cremers: The Double Sphere Camera Model, 3DV 2018; basalt's `ds`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import TINY, Array, Flags
from sphere_nav.geometry.cameras.camera import Focal, inside


def from_sphere(xy: Array, z: Array | float, xi: float) -> Array:
    """Return the unit rays (..., 3) that a centre `xi` behind that of the unit sphere sees in directions (xy, z)."""
    r2 = np.sum(xy * xy, axis=-1)
    with np.errstate(invalid="ignore"):
        scale = (z * xi + np.sqrt(z * z + (1 - xi * xi) * r2)) / (z * z + r2)
    return np.concatenate([scale[..., None] * xy, (scale * z - xi)[..., None]], axis=-1)


@dataclass(frozen=True)
class DoubleSphere(Focal):
    """Optical frame: z forward, x right, y down; wide fisheyes in closed form.

    A point goes to a unit sphere, to a second one `xi` further along the axis, and from there to the image by a pinhole
    whose centre is shifted by alpha / (1 - alpha). xi = alpha = 0 is the pinhole camera.
    """

    xi: float = 0.0
    alpha: float = 0.0
    model: ClassVar[str] = "double_sphere"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (-1.0 < self.xi <= 1.0 and 0.0 <= self.alpha <= 1.0):
            raise ValueError(
                f"double sphere: expected -1 < xi <= 1 and 0 <= alpha <= 1, found xi {self.xi}, alpha {self.alpha}"
            )

    @cached_property
    def coefficients(self) -> Array:
        """Those of a pinhole (13), xi, alpha, and the least cosines seen from the first centre and the second."""
        plane = (self.fx, self.fy, self.cx, self.cy, *(0.0,) * 8, np.inf)
        return np.array([*plane, self.xi, self.alpha, -2.0, self.min_cosine])

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the optical axis."""
        return super().pixels_per_radian / (1 + self.xi)

    @property
    def min_cosine(self) -> float:
        """Cosine of the largest angle, seen from the second centre, that has a pixel of its own (-w1 of the paper).

        The paper's bound on the angle from the first centre (eq. 43) refuses a few degrees that do have one.
        """
        a = self.alpha
        return -(a / (1 - a) if a <= 0.5 else (1 - a) / a)

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3); points beyond the largest angle are NaN and not visible."""
        p = np.asarray(points, dtype=np.float64)
        shifted = self.xi * np.linalg.norm(p, axis=-1) + p[..., 2]
        second = np.sqrt(p[..., 0] ** 2 + p[..., 1] ** 2 + shifted**2)
        divisor = self.alpha * second + (1 - self.alpha) * shifted  # eq. 40 to 42
        valid = (shifted > self.min_cosine * second) & (divisor > TINY * second)
        factor = np.where(valid, 1.0 / np.where(valid, divisor, 1.0), np.nan)
        pixels = factor[..., None] * p[..., :2] * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels, inside(pixels, self)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3); NaN where the model has no ray."""
        m = (np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)
        r2, a = np.sum(m * m, axis=-1), self.alpha
        with np.errstate(invalid="ignore"):
            mz = (1 - a * a * r2) / (a * np.sqrt(1 - (2 * a - 1) * r2) + 1 - a)
        return from_sphere(m, mz, self.xi)
