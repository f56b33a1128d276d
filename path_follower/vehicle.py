"""The car: kinematics of the base point, limits of every command, and where it will be when a command acts.

The base point is the middle of the rear axle; with steered rear wheels see `VehicleParams.virtual_wheelbase`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from path_follower.constants import (
    HISTORY_NS,
    MAX_POSE_AGE,
    MAX_STEP_NS,
    PREDICTION_STEP,
    STANDING,
    TURNED,
)
from path_follower.params import ActuationParams, VehicleParams
from path_follower.path import Pose2
from sphere_nav.geometry.arrays import TINY


@dataclass(frozen=True)
class Motion:
    """Speed of the rear axle in m/s (negative: backwards) and angle of the front wheel in rad (positive: left)."""

    speed: float
    steering_angle: float

    def yaw_rate(self, wheelbase: float) -> float:
        """Return the yaw rate of the rear axle in rad/s."""
        return self.speed * math.tan(self.steering_angle) / wheelbase


STANDSTILL = Motion(0.0, 0.0)
ORIGIN = Pose2(0.0, 0.0, 0.0)


def drive(pose: Pose2, motion: Motion, wheelbase: float, seconds: float) -> Pose2:
    """Return the pose after driving a circle of curvature tan(angle) / wheelbase for a time: exact."""
    way = motion.speed * seconds
    turn = way * math.tan(motion.steering_angle) / wheelbase
    chord = way * (math.sin(turn / 2) / (turn / 2) if abs(turn) > 1e-9 else 1.0)
    middle = pose.yaw + turn / 2
    return Pose2(pose.x + chord * math.cos(middle), pose.y + chord * math.sin(middle), pose.yaw + turn)


def braked(motion: Motion, loss: float) -> Motion:
    """Return a motion that is slower by `loss` m/s, at most to standstill, the wheel as it is."""
    return Motion(math.copysign(max(0.0, abs(motion.speed) - loss), motion.speed), motion.steering_angle)


class Limiter:
    """Lets no command through that breaks a limit of the car. Holds the last one, from which changes are counted."""

    def __init__(self, params: VehicleParams) -> None:
        """Begin at standstill, wheels straight."""
        self.params = params
        self.is_launch = True
        self.last = STANDSTILL
        self.last_ns: int | None = None
        self.gain = 0.0  # m/s^2 of the magnitude of the speed, in the last command

    def limit(
        self, speed: float, curvature: float | None, now_ns: int, *, is_hard: bool, is_stop: bool = False
    ) -> Motion:
        """Return the nearest motion that is allowed: m/s, 1/m (None: the wheels stay); `is_hard`: a stop for safety.

        `is_stop`: any other stop; no more speed is gained, whatever the jerk. At standstill the wheels do not turn; a
        change of direction passes through standstill.
        """
        limits = self.params
        if self.last_ns is not None and now_ns < self.last_ns:
            self.last_ns = now_ns  # a stamp had run ahead: what follows must not wait for it
        seconds = 0.0 if self.last_ns is None else min(max(now_ns - self.last_ns, 0), MAX_STEP_NS) / 1e9
        wanted = self.last.steering_angle if curvature is None else self._angle(curvature)
        goal = clip(speed, limits.max_speed) if math.isfinite(speed) else 0.0
        if is_stop:
            self.gain = min(self.gain, 0.0)
        new_speed = self._towards(goal, seconds, is_hard=is_hard)
        angle = self.last.steering_angle
        if new_speed != 0.0:
            step = limits.max_steering_rate * seconds
            angle = min(max(wanted, angle - step), angle + step)
        self.last, self.last_ns = Motion(new_speed, angle), now_ns
        return self.last

    def stand(self) -> None:
        """Begin again at standstill, the wheels as they are."""
        self.last, self.gain = Motion(0.0, self.last.steering_angle), 0.0

    def is_starting(self, curvature: float) -> bool:
        """Return whether the vehicle sets off from standstill and its wheels do not yet stand as a curvature asks."""
        is_turned = abs(self._angle(curvature) - self.last.steering_angle) <= TURNED
        self.is_launch = (self.is_launch or self.last.speed == 0.0) and not is_turned
        return self.is_launch

    def _angle(self, curvature: float) -> float:
        if not math.isfinite(curvature):
            return self.last.steering_angle
        return clip(math.atan(self.params.virtual_wheelbase * curvature), self.params.max_steering_angle)

    def _towards(self, goal: float, seconds: float, *, is_hard: bool) -> float:
        """Return the speed after a time, eased into the goal; a stop for safety brakes at once."""
        sign, speed = math.copysign(1.0, self.last.speed or goal), abs(self.last.speed)
        goal = max(0.0, sign * goal)
        if is_hard:
            self.gain = 0.0
            return sign * max(min(goal, speed), speed - self.params.stop_deceleration * seconds)
        return sign * self._ease(speed, goal, seconds)

    def _ease(self, speed: float, goal: float, seconds: float) -> float:
        """Return the speed after a time on the fastest way to the goal that ends there with no gain left.

        With jerk j a gain g that falls to 0 changes the speed by g |g| / (2 j): where that is what is left, it falls;
        before, it grows up to its limit. All pieces are exact, so that the way does not depend on how it is cut up.
        """
        p, jerk = self.params, self.params.max_jerk
        while seconds > 0.0:
            left = goal - speed - self.gain * abs(self.gain) / (2.0 * jerk)
            if abs(left) < TINY:  # the gain falls, and then it is there
                rate, span = -math.copysign(jerk, self.gain), abs(self.gain) / jerk
                if span <= seconds:
                    speed, self.gain = goal, 0.0
                    break
            else:
                towards = math.copysign(1.0, left)
                gain, most = towards * self.gain, p.max_acceleration if left > 0.0 else p.max_deceleration
                rate = towards * jerk
                if gain < 0.0:
                    span = -gain / jerk
                elif gain < most:
                    turning = (math.sqrt(gain**2 + jerk * abs(left)) - gain) / jerk
                    span = min((most - gain) / jerk, turning)
                else:
                    self.gain, rate, span = towards * most, 0.0, abs(left) / most
            step = min(span, seconds)
            speed += (self.gain + 0.5 * rate * step) * step
            self.gain = 0.0 if step == span and self.gain * rate < 0.0 else self.gain + rate * step
            seconds -= step
        if speed <= 0.0:
            self.gain = 0.0
            return 0.0
        return min(speed, p.max_speed)


class Predictor:
    """A model of the actuators that follows the commands given, to see the pose at the time a command acts."""

    def __init__(self, vehicle: VehicleParams, actuation: ActuationParams) -> None:
        """Begin at standstill."""
        self.vehicle = vehicle
        self.actuation = actuation
        self.history: deque[tuple[int, Motion, Motion]] = deque()  # when, what was commanded, and what was done then

    @property
    def motion(self) -> Motion:
        """What the actuators are thought to do now."""
        return self.history[-1][2] if self.history else STANDSTILL

    @property
    def is_standing(self) -> bool:
        """Whether the vehicle is thought to stand."""
        return abs(self.motion.speed) < STANDING

    def remember(self, now_ns: int, command: Motion) -> None:
        """Take note of a command that was given."""
        self.history.append((now_ns, command, self._state_at(now_ns)))
        while len(self.history) > 2 and self.history[1][0] < now_ns - HISTORY_NS:
            self.history.popleft()

    def predict(self, pose: Pose2, stamp_ns: int, now_ns: int, speed: float | None) -> Pose2:
        """Return the pose when a command given now has acted: at now + dead time + steering lag.

        `speed` m/s is the measured one at the stamp, where there is one; else that of the model.
        """
        wanted = max(0, now_ns - stamp_ns) / 1e9
        age_ns = round(min(wanted, MAX_POSE_AGE) * 1e9)
        state = self._state_at(now_ns - age_ns)
        if speed is not None and math.isfinite(speed):
            state = Motion(speed, state.steering_angle)
        horizon = round((self.actuation.dead_time + self.actuation.steering_lag) * 1e9)
        return self._run(state, now_ns - age_ns, now_ns + horizon, pose)[1]

    def travel(self, from_ns: int, to_ns: int) -> tuple[Pose2, Motion, Motion]:
        """Return the way driven by the commands between two times, seen from its begin, and the motion at both."""
        before = self._state_at(from_ns)
        after, way = self._run(before, from_ns, to_ns)
        return way, before, after

    def reset(self) -> None:
        """Forget everything."""
        self.history.clear()

    def _given(self, stamp_ns: int) -> tuple[int, Motion, Motion]:
        """Return the last entry of the history at a time; before the first one the car stood."""
        before = (entry for entry in reversed(self.history) if entry[0] <= stamp_ns)
        return next(before, (stamp_ns, STANDSTILL, STANDSTILL))

    def _state_at(self, stamp_ns: int) -> Motion:
        then, _, state = self._given(stamp_ns)
        return self._run(state, then, stamp_ns)[0]

    def _run(self, state: Motion, from_ns: int, to_ns: int, pose: Pose2 = ORIGIN) -> tuple[Motion, Pose2]:
        """Let the actuators follow the commands known, first-order lags after a dead time.

        Where the clock leaps, through the last `HISTORY_NS` alone: years of /clock would take hours.
        """
        speed, angle, now = state.speed, state.steering_angle, max(from_ns, to_ns - HISTORY_NS)
        dead_ns = round(self.actuation.dead_time * 1e9)
        while now < to_ns:
            end = min(now + round(PREDICTION_STEP * 1e9), to_ns)
            seconds = (end - now) / 1e9
            _, command, _ = self._given(now - dead_ns)
            speed += (command.speed - speed) * _share(seconds, self.actuation.speed_lag)
            angle += (command.steering_angle - angle) * _share(seconds, self.actuation.steering_lag)
            pose = drive(pose, Motion(speed, angle), self.vehicle.virtual_wheelbase, seconds)
            now = end
        return Motion(speed, angle), pose


def _share(seconds: float, lag: float) -> float:
    return 1.0 - math.exp(-seconds / lag) if lag > 0 else 1.0


def clip(value: float, limit: float) -> float:
    """Return a value within +-limit."""
    return min(max(value, -limit), limit)
