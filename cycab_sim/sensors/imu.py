"""What an IMU on the car measures: specific force, angular rate and orientation, with biases, their walk and noise.

The true values are differences of its true poses, so that their integral is where the car really went: the rate is the
mean of the last step, the force that between the last two steps. The kink of a ramp is a jolt, as on a real one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cycab_sim.params import ImuParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array

GRAVITY = 9.80665  # m/s^2
UP = np.array([0.0, 0.0, GRAVITY])


@dataclass(frozen=True)
class ImuErrors:
    """Standard deviations, of an inexpensive MEMS sensor; noise is that of one message."""

    acceleration_noise: float = 0.03  # m/s^2
    acceleration_bias: float = 0.02  # of the bias, drawn once an axis, m/s^2
    acceleration_walk: float = 0.0005  # of its random walk after 1 s, m/s^2
    rate_noise: float = 0.002  # rad/s
    rate_bias: float = 0.001  # of the bias, drawn once an axis, rad/s
    rate_walk: float = 0.00002  # of its random walk after 1 s, rad/s
    orientation_noise_deg: float = 0.2


@dataclass(frozen=True, eq=False)
class ImuReading:
    """Specific force (3,) m/s^2 (upwards 9.8 at rest) and angular rate (3,) rad/s in the axes of the IMU.

    Its orientation in the world has a heading that drifts with the measured rate: there is no compass.
    """

    acceleration: Array
    angular_rate: Array
    T_world_imu: SE3


class Imu:
    """Follows the car; `read` gives a reading of the present instant."""

    def __init__(self, params: ImuParams, seed: int, errors: ImuErrors | None = None) -> None:
        self.errors = errors = errors or ImuErrors()
        self.T_base_imu = SE3.from_parts(np.eye(3), params.place)
        self._seed = seed
        self._rng = np.random.default_rng([seed, 23])
        self._biases = self._rng.standard_normal((2, 3)) * [[errors.acceleration_bias], [errors.rate_bias]]
        self._force, self._rate = UP, np.zeros(3)
        self._velocity: Array | None = None
        self._heading_error = 0.0

    def step(self, T_world_base: SE3, T_world_base_after: SE3, seconds: float) -> None:
        """Move from one true pose of the car to the next."""
        before, after = T_world_base @ self.T_base_imu, T_world_base_after @ self.T_base_imu
        self._rate = (before.inverse() @ after).log()[3:] / seconds
        velocity = (after.translation - before.translation) / seconds
        change = np.zeros(3) if self._velocity is None else (velocity - self._velocity) / seconds
        self._velocity = velocity
        self._force = before.rotation.T @ (change + UP)
        walks = np.array([[self.errors.acceleration_walk], [self.errors.rate_walk]]) * math.sqrt(seconds)
        self._biases = self._biases + walks * self._rng.standard_normal((2, 3))
        self._heading_error += float(self._biases[1, 2]) * seconds

    def forget(self) -> None:
        """Take the next step as the first: the car was put elsewhere, which no IMU would survive."""
        self._velocity = None

    def read(self, T_world_base: SE3, index: int) -> ImuReading:
        """Return reading number `index`, for the true pose of the car at this instant."""
        p = self.errors
        noise = np.random.default_rng([self._seed, index, 29]).standard_normal((3, 3))
        tilt = math.radians(p.orientation_noise_deg) * noise[2]
        true = T_world_base @ self.T_base_imu
        turn = SE3.from_planar(0.0, 0.0, self._heading_error)
        measured = turn @ SE3.from_parts(true.rotation, np.zeros(3)) @ SE3.exp(np.concatenate([np.zeros(3), tilt]))
        force = self._force + self._biases[0] + p.acceleration_noise * noise[0]
        rate = self._rate + self._biases[1] + p.rate_noise * noise[1]
        return ImuReading(force, rate, measured)
