"""The driver of the teaching drive: steers towards the path a little ahead, slows down for bends and the end."""

from __future__ import annotations

import math

import numpy as np

from cycab_sim.params import TeachParams
from cycab_sim.paths import Path
from cycab_sim.vehicle import Command, VehicleState

ARRIVED = 0.05  # m before the end
WAVES = (0.031, 0.073, 0.117)  # a wandering line: waves per metre
CREEP = 0.08  # m/s, so that the last centimetres end


class Driver:
    """Pure pursuit along a path, with a smooth speed; remembers how far it has come."""

    def __init__(self, path: Path, params: TeachParams, seed: int) -> None:
        self.path = path
        self.params = params
        self.distance = 0.0
        self._phases = np.random.default_rng([seed, 21]).uniform(0.0, 2 * np.pi, len(WAVES))

    @property
    def is_done(self) -> bool:
        """Whether the end has been reached; a closed path ends where it began."""
        return self.distance > self.path.length - ARRIVED

    def command(self, state: VehicleState) -> Command:
        """Return speed and yaw rate for where the car is now."""
        self.distance = max(self.distance, self.path.project(state.x, state.y, self.distance))
        if self.is_done:
            return Command()
        speed = self._speed()
        dx, dy = self._target() - (state.x, state.y)
        ahead = math.cos(state.yaw) * dx + math.sin(state.yaw) * dy
        aside = math.cos(state.yaw) * dy - math.sin(state.yaw) * dx
        curvature = 2.0 * aside / max(ahead * ahead + aside * aside, 1e-3)
        return Command(speed, speed * curvature)

    def _target(self) -> np.ndarray:
        """Return the point (2,) m to steer towards: on the path, a little off it as humans are."""
        s = self.distance + self.params.look_ahead
        x, y, yaw, _ = self.path.at(np.array(s))
        fade = min(1.0, s / 5.0)
        off = self.params.wander * fade * float(np.mean(np.sin(2 * np.pi * np.array(WAVES) * s + self._phases)))
        return np.array([x - off * np.sin(yaw), y + off * np.cos(yaw)])

    def _speed(self) -> float:
        """Return the largest speed from which every bend ahead and the end can be met by gentle braking."""
        p = self.params
        reach = p.speed**2 / (2.0 * p.acceleration) + 1.0
        s = self.distance + np.linspace(0.0, reach, 40)
        curvature = np.abs(self.path.at(s)[:, 3])
        bend = np.sqrt(p.lateral_acceleration / np.maximum(curvature, 1e-6))
        allowed = np.sqrt(np.minimum(bend, p.speed) ** 2 + 2.0 * p.acceleration * (s - self.distance))
        rest = max(self.path.length - ARRIVED - self.distance, 0.0)
        start = math.sqrt(CREEP + 2.0 * p.acceleration * self.distance)
        end = math.sqrt(2.0 * p.acceleration * rest) + CREEP
        return float(min(allowed.min(), p.speed, start, end))
