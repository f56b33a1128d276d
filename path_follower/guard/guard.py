"""Lets commands through that are fresh and within limits; else a ramp to zero, on the curve that was driven.

After a stop it lets nothing through until zero has been commanded once: a process that wakes up, or a network that
comes back, does not set the vehicle in motion with an old wish. Times are seconds of any steady clock.
"""

from __future__ import annotations

import enum
import math

from path_follower.guard.params import GuardParams
from path_follower.vehicle import clip


class GuardReason(enum.StrEnum):
    """The words of GuardStatus."""

    NONE = ""
    NO_COMMAND = "NO_COMMAND"
    NO_HEARTBEAT = "NO_HEARTBEAT"
    WAITS_FOR_ZERO = "WAITS_FOR_ZERO"
    COMMAND_SOURCE = "COMMAND_SOURCE"
    EMERGENCY_STOP = "EMERGENCY_STOP"


AWAITED = (GuardReason.NO_COMMAND, GuardReason.WAITS_FOR_ZERO)  # a zero command mends it: what a start begins with


class Guard:
    """Call `pass_on` regularly; what it returns is for the base."""

    def __init__(self, params: GuardParams) -> None:
        self.params = params
        self.is_emergency = False
        self.doubt = ""  # why it is not known who commands; empty: it is
        self.reason, self.detail = GuardReason.NO_COMMAND, "none yet"
        self._wanted = (0.0, 0.0)
        self._last = (0.0, 0.0)
        self._count = -1
        self._command_at = self._beat_at = self._passed_at = -math.inf

    def see_command(self, speed: float, yaw_rate: float, now: float) -> None:
        """Accept a command, m/s and rad/s; ValueError for one that is no number, which counts as none."""
        if not (math.isfinite(speed) and math.isfinite(yaw_rate)):
            raise ValueError(f"cmd_vel_in: expected finite numbers, found {speed}, {yaw_rate}")
        self._wanted, self._command_at = (speed, yaw_rate), now
        if speed == 0.0 and not self._fault(now)[0]:
            self.reason, self.detail = GuardReason.NONE, ""

    def see_heartbeat(self, count: int, now: float) -> None:
        """Accept a heartbeat; only a count after another one is: a single one may have been sent long ago."""
        if self._count not in (-1, count):
            self._beat_at = now
        self._count = count

    def pass_on(self, now: float) -> tuple[float, float]:
        """Return the speed m/s and yaw rate rad/s for now."""
        p, (fault, found) = self.params, self._fault(now)
        if fault:
            self.reason, self.detail = fault, found
        elif self.reason:
            self.reason, self.detail = GuardReason.WAITS_FOR_ZERO, "lets nothing through until zero was commanded once"
        seconds = min(max(now - self._passed_at, 0.0), 0.1)
        self._passed_at = now
        speed, yaw_rate = (0.0, 0.0) if self.reason else self._wanted
        limited = self._towards(clip(speed, p.max_speed), seconds)
        basis, turn = self._last if self.reason or speed == 0.0 else (speed, yaw_rate)
        yaw_rate = clip(turn * limited / basis, p.max_yaw_rate) if basis else 0.0
        self._last = (limited, yaw_rate)
        return self._last

    def _fault(self, now: float) -> tuple[GuardReason, str]:
        limit = self.params.deadline
        if self.is_emergency:
            return GuardReason.EMERGENCY_STOP, "pressed"
        if self.doubt:
            return GuardReason.COMMAND_SOURCE, self.doubt
        if now - self._command_at > limit:
            return GuardReason.NO_COMMAND, f"none for more than {limit:g} s"
        if self.params.is_heartbeat_required and now - self._beat_at > limit:
            return GuardReason.NO_HEARTBEAT, f"none for more than {limit:g} s"
        return GuardReason.NONE, ""

    def _towards(self, goal: float, seconds: float) -> float:
        last = self._last[0]
        goal = 0.0 if last * goal < 0.0 else goal
        limit = self.params.max_acceleration if abs(goal) > abs(last) else self.params.max_deceleration
        return last + clip(goal - last, limit * seconds)
