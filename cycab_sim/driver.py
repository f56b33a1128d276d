"""The driver of the teaching drive: steers towards the path a little ahead, slows down for bends and the end."""

from __future__ import annotations

import math

import numpy as np

from cycab_sim.params import TeachParams
from cycab_sim.vehicle import VehicleCommand, VehicleState
from cycab_sim.world.paths import Path
from sphere_nav.geometry.arrays import Array

SPACING = 0.02  # m between the points the driver looks at
REACH = 100  # points ahead among which the closest one is looked for
ARRIVED = 0.05  # m before the end
CREEP = 0.08  # m/s, so that the first and the last centimetres end
WAVES = (0.031, 0.073, 0.117)  # a wandering line: waves per metre
FADE = 5.0  # m over which the wandering begins


class PurePursuitDriver:
    """Pure pursuit along a path, with a smooth speed; remembers how far it has come."""

    def __init__(self, path: Path, params: TeachParams, seed: int) -> None:
        self.path = path
        self.params = params
        self.distance = 0.0
        s = np.arange(0.0, path.length + params.look_ahead + 1.0, SPACING)
        poses = path.at(s)
        phases = np.random.default_rng([seed, 21]).uniform(0.0, 2 * np.pi, (len(WAVES), 1))
        wave = np.mean(np.sin(2 * np.pi * np.array(WAVES)[:, None] * s + phases), axis=0)
        off = params.wander * np.minimum(1.0, s / FADE) * wave
        normals = np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
        self._points = poses[:, :2]
        self._targets = poses[:, :2] + off[:, None] * normals
        self._speeds = _speeds(s, poses[:, 3], path.length - ARRIVED, params)

    @property
    def is_done(self) -> bool:
        """Whether the end has been reached; a closed path ends where it began."""
        return self.distance > self.path.length - ARRIVED

    def command(self, state: VehicleState) -> VehicleCommand:
        """Return speed and yaw rate for where the car is now."""
        here = self._locate(state)
        if self.is_done:
            return VehicleCommand()
        speed = float(self._speeds[here])
        target = self._targets[min(here + round(self.params.look_ahead / SPACING), len(self._targets) - 1)]
        dx, dy = float(target[0]) - state.x, float(target[1]) - state.y
        ahead = math.cos(state.yaw) * dx + math.sin(state.yaw) * dy
        aside = math.cos(state.yaw) * dy - math.sin(state.yaw) * dx
        curvature = 2.0 * aside / max(ahead * ahead + aside * aside, 1e-3)
        return VehicleCommand(speed, speed * curvature)

    def _locate(self, state: VehicleState) -> int:
        """Return the number of the closest point at or after the last one."""
        last = int(self.distance / SPACING)
        off = self._points[last : last + REACH] - (state.x, state.y)
        here = last + int(np.argmin(np.sum(off * off, axis=1)))
        self.distance = max(self.distance, (here + 0.5) * SPACING)
        return here


def _speeds(s: Array, curvature: Array, end: float, params: TeachParams) -> Array:
    """Return the largest speed at each distance from which bends and the end can be met by gentle braking."""
    bend = np.sqrt(params.lateral_acceleration / np.maximum(np.abs(curvature), 1e-6))
    squares = np.minimum(bend, params.speed) ** 2
    squares[s >= end] = 0.0
    rise = 2.0 * params.acceleration * s  # v^2 = v0^2 + 2 a s, backwards for braking and forwards for the start
    braking = np.minimum.accumulate((squares + rise)[::-1])[::-1] - rise
    gaining = np.minimum.accumulate(braking - rise) + rise
    gaining = np.minimum(gaining, CREEP**2 + rise)
    return np.sqrt(np.maximum(gaining, CREEP**2)) * (s < end)
