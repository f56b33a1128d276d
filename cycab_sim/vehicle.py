"""The Cycab: a bicycle whose actuators lag and have limits; its poses are exact arcs between two steps."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.world.paths import arc
from sphere_nav.geometry import SE3

STANDSTILL = 0.02  # below this speed a yaw rate says nothing about the steering angle, m/s


@dataclass(frozen=True)
class VehicleCommand:
    """What the car is asked for: speed of the rear axle m/s and yaw rate rad/s, as in a Twist."""

    speed: float = 0.0
    yaw_rate: float = 0.0


@dataclass(frozen=True)
class VehicleState:
    """Pose of the rear axle's middle (m, rad), its speed m/s and the steering angle rad."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    speed: float = 0.0
    steering: float = 0.0

    @property
    def T_world_base(self) -> SE3:
        """Pose of the car."""
        return SE3.from_planar(self.x, self.y, self.yaw)


class Vehicle:
    """Moves a state by commands."""

    def __init__(self, state: VehicleState, params: CarParams, actuation: ActuatorParams) -> None:
        self.state = state
        self.params = params
        self.actuation = actuation
        self._pending: deque[tuple[float, VehicleCommand]] = deque()
        self._now = 0.0

    @property
    def yaw_rate(self) -> float:
        """True yaw rate, rad/s."""
        return self.state.speed * math.tan(self.state.steering) / self.params.wheelbase

    def step(self, command: VehicleCommand, seconds: float) -> None:
        """Drive for `seconds`: the actuators move, then an arc at their mean."""
        before = self.state
        wanted = self._delay(command, seconds)
        speed = self._follow_speed(wanted.speed, seconds)
        steering = self._follow_steering(self._steering_for(wanted), seconds)
        mean_speed, mean_steering = (before.speed + speed) / 2, (before.steering + steering) / 2
        curvature = math.tan(mean_steering) / self.params.wheelbase
        x, y, yaw = arc((before.x, before.y, before.yaw), mean_speed * seconds, curvature)
        self.state = VehicleState(float(x), float(y), float(yaw), speed, steering)

    def _delay(self, command: VehicleCommand, seconds: float) -> VehicleCommand:
        """Return the command that was given one dead time ago."""
        self._pending.append((self._now, command))
        self._now += seconds
        while len(self._pending) > 1 and self._pending[1][0] <= self._now - seconds - self.actuation.dead_time + 1e-9:
            self._pending.popleft()
        is_due = self._pending[0][0] <= self._now - seconds - self.actuation.dead_time + 1e-9
        return self._pending[0][1] if is_due else VehicleCommand()

    def _follow_speed(self, wanted: float, seconds: float) -> float:
        p, now = self.params, self.state.speed
        goal = min(max(wanted, -p.max_reverse_speed), p.max_speed)
        change = _lag(goal - now, self.actuation.speed_lag, seconds)
        limit = p.max_acceleration if change * now >= 0.0 and abs(goal) > abs(now) else p.max_deceleration
        speed = now + min(max(change, -limit * seconds), limit * seconds)
        return 0.0 if speed * now < 0.0 else speed  # a change of direction begins at a standstill

    def _steering_for(self, command: VehicleCommand) -> float:
        """Return the steering angle of a yaw rate; at a standstill the wheels stay as they are."""
        if abs(command.speed) < STANDSTILL:
            return self.state.steering
        angle = math.atan(self.params.wheelbase * command.yaw_rate / command.speed)
        return min(max(angle, -self.params.max_steering_angle), self.params.max_steering_angle)

    def _follow_steering(self, wanted: float, seconds: float) -> float:
        change = _lag(wanted - self.state.steering, self.actuation.steering_lag, seconds)
        limit = self.params.max_steering_rate * seconds
        return self.state.steering + min(max(change, -limit), limit)


@dataclass(frozen=True)
class WheelErrors:
    """What wheel odometry measures wrongly; noise is that of one message."""

    slip: float = 0.005  # share of the wheel motion that does not move the car
    yaw_rate_scale: float = 1.01  # measured yaw rate over true yaw rate
    yaw_rate_bias: float = 0.0005  # rad/s while driving
    speed_noise: float = 0.01  # standard deviation of the speed, m/s
    yaw_rate_noise: float = 0.003  # standard deviation of the yaw rate, rad/s


class WheelOdometry:
    """Integrates what the wheels say: slip, a wrong yaw-rate scale and bias, and noise; `period` s between messages."""

    def __init__(self, period: float, seed: int, errors: WheelErrors | None = None) -> None:
        self.errors = errors or WheelErrors()
        self.period = period
        self.pose = np.zeros(3)
        self.speed = self.yaw_rate = 0.0
        self.way = self.turned = 0.0
        self._rng = np.random.default_rng([seed, 11])

    def step(self, speed: float, yaw_rate: float, seconds: float, errors: WheelErrors | None = None) -> None:
        """Measure the true speed m/s and yaw rate rad/s over `seconds`, and move the pose by what was measured."""
        p = errors or self.errors
        is_moving = abs(speed) > 1e-3
        scale = math.sqrt(self.period / seconds)  # noise is given for one message, steps are shorter
        noise = self._rng.standard_normal(2) * scale * is_moving
        self.speed = speed / (1.0 - p.slip) + p.speed_noise * noise[0]
        self.yaw_rate = p.yaw_rate_scale * yaw_rate + p.yaw_rate_bias * is_moving + p.yaw_rate_noise * noise[1]
        curvature = self.yaw_rate / self.speed if abs(self.speed) > 1e-6 else 0.0
        self.pose = arc(self.pose, self.speed * seconds, curvature)
        self.way += abs(self.speed) * seconds
        self.turned += abs(self.yaw_rate) * seconds

    @property
    def T_odom_base(self) -> SE3:
        """Pose of the car as the wheels have it, from where it started."""
        return SE3.from_planar(*map(float, self.pose))

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations (6,) of the pose, m and rad, growing with the way; the height and tilt do not change."""
        p = self.errors
        share = p.slip + abs(p.yaw_rate_scale - 1.0)
        along, turn = 0.01 + share * self.way, 0.005 + share * self.turned
        return np.array([along, along + turn * self.way / 2, 1e-3, 1e-3, 1e-3, turn])


def _lag(difference: float, time_constant: float, seconds: float) -> float:
    """Return the change of a first-order lag over `seconds`: exact for a constant input."""
    return difference if time_constant <= 0.0 else difference * -math.expm1(-seconds / time_constant)
