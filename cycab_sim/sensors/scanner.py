"""A laser scanner: rays in one plane of the car, by the caster of the images, with range noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import ScanParams
from sphere_nav.geometry import SE3

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Scan:
    """Ranges (N,) f32 m of one instant: +Inf where nothing is within reach, -Inf where it is too close (REP 117)."""

    ranges: Floats
    stamp_ns: int


class Scanner:
    """Looks along `num_rays` directions, counter-clockwise, both ends included."""

    def __init__(self, params: ScanParams, seed: int) -> None:
        if params.first_deg >= params.last_deg:
            raise ValueError(
                f"scan.last_deg: expected more than first_deg = {params.first_deg}, found {params.last_deg}"
            )
        self.params = params
        self.T_base_scan = SE3.from_parts(np.eye(3), [params.x, params.y, params.z])
        self.angles = np.radians(np.linspace(params.first_deg, params.last_deg, params.num_rays))
        self._rays = np.stack([np.cos(self.angles), np.sin(self.angles), np.zeros(params.num_rays)], axis=1)
        self._seed = seed

    def scan(
        self, measure: Callable[[NDArray[np.float64], Floats], Floats], T_world_base: SE3, index: int, stamp_ns: int
    ) -> Scan:
        """Return scan number `index`; `measure(origin (3,), rays (N, 3))` gives true ranges (N,), see Renderer."""
        p = self.params
        T_world_scan = T_world_base @ self.T_base_scan
        rays = (self._rays @ T_world_scan.rotation.T).astype(np.float32)
        ranges = measure(np.ascontiguousarray(T_world_scan.translation), rays)
        noise = np.random.default_rng([self._seed, index, 31]).standard_normal(len(ranges), dtype=np.float32)
        ranges = ranges + np.float32(p.noise) * noise
        ranges[ranges > p.max_range] = np.inf
        ranges[ranges < p.min_range] = -np.inf
        return Scan(ranges, stamp_ns)
