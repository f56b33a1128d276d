"""The parts that things of the simulated world are built of, one by one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from cycab_sim.world.mesh import Finish, MeshBuilder
from sphere_nav.geometry.arrays import Array


@dataclass
class Part:
    """Quadrilaterals (N, 4, 3) m of one finish; a hull, or panels that lie on one."""

    quads: Array
    finish: Finish

    @property
    def points(self) -> Array:
        return self.quads.reshape(-1, 3)

    @property
    def bounds(self) -> Array:
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    def looks_outward(self) -> bool:
        """Whether every side of a hull looks away from its middle."""
        across = np.cross(self.quads[:, 2] - self.quads[:, 0], self.quads[:, 3] - self.quads[:, 1])
        away = self.quads.mean(axis=1) - self.points.mean(axis=0)
        return bool(np.all(np.sum(across * away, axis=1) > 0))

    def is_symmetric(self, axis: int = 1, middle: float = 0.0) -> bool:
        values = np.sort(self.points[:, axis] - middle)
        return np.allclose(values, -values[::-1], atol=1e-9)

    def touches(self, other: Part, gap: float) -> bool:
        (low, high), (others_low, others_high) = self.bounds, other.bounds
        return bool(np.all(low <= others_high + gap) and np.all(others_low <= high + gap))


@dataclass
class Recorder(MeshBuilder):
    """A builder that keeps what it is given, part by part."""

    parts: list[Part] = field(default_factory=list)

    def panels(self, corners: ArrayLike, finish: Finish) -> None:
        self.parts.append(Part(np.asarray(corners, np.float64).reshape(-1, 4, 3), finish))
        super().panels(corners, finish)

    def sheet(self, corners: ArrayLike, finish: Finish, frame: ArrayLike) -> None:
        self.parts.append(Part(np.asarray(corners, np.float64).reshape(-1, 4, 3), finish))
        super().sheet(corners, finish, frame)


def floating(parts: list[Part], gap: float = 0.02) -> list[Part]:
    """Return the parts that neither stand on the ground nor touch, directly or not, what does; `gap` in m."""
    held = [part for part in parts if part.bounds[0, 2] <= gap]
    loose = [part for part in parts if part.bounds[0, 2] > gap]
    while news := [part for part in loose if any(part.touches(other, gap) for other in held)]:
        held += news
        loose = [part for part in loose if not any(part is new for new in news)]
    return loose
