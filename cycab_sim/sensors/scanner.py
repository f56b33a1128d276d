"""A laser scanner: rays in one plane of the car, by the caster of the images, with range noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Floats


@dataclass(frozen=True)
class ScannerModel:
    """A common scanner of 270 deg with two rays a degree, at the front of the car."""

    first_deg: float = -135.0  # direction of the first ray, positive to the left
    last_deg: float = 135.0
    num_rays: int = 541
    min_range: float = 0.05  # m
    max_range: float = 30.0  # m
    noise: float = 0.01  # standard deviation of the range, m
    x: float = 1.5  # place on the car, forward of the rear axle, m
    z: float = 0.6  # height above the ground, m


class Scanner:
    """Looks along `num_rays` directions, counter-clockwise, both ends included."""

    def __init__(self, seed: int, model: ScannerModel | None = None) -> None:
        self.model = p = model or ScannerModel()
        self.T_base_scan = SE3.from_parts(np.eye(3), [p.x, 0.0, p.z])
        self.angles = np.radians(np.linspace(p.first_deg, p.last_deg, p.num_rays))
        self._rays = np.stack([np.cos(self.angles), np.sin(self.angles), np.zeros(p.num_rays)], axis=1)
        self._seed = seed

    def scan(self, measure: Callable[[Array, Floats], Floats], T_world_base: SE3, index: int) -> Floats:
        """Return the ranges (N,) m of scan number `index`: +Inf: nothing within reach, -Inf: too close (REP 117).

        `measure(origin (3,), rays (N, 3))` gives true ranges (N,), see Renderer.
        """
        p = self.model
        T_world_scan = T_world_base @ self.T_base_scan
        rays = (self._rays @ T_world_scan.rotation.T).astype(np.float32)
        ranges = measure(np.ascontiguousarray(T_world_scan.translation), rays)
        noise = np.random.default_rng([self._seed, index, 31]).standard_normal(len(ranges), dtype=np.float32)
        ranges = ranges + np.float32(p.noise) * noise
        ranges[ranges > p.max_range] = np.inf
        ranges[ranges < p.min_range] = -np.inf
        return ranges
