"""Mei's camera with distortion (Mei, Rives: Single View Point Omnidirectional Camera Calibration, ICRA 2007)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sphere_nav.geometry.cameras.double_sphere import SphereCamera

MAX_XI = 1e3  # a mirror's is 1 at most, a fisheye's 1 to 3


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
