"""What may be asked of a follower, and what it holds: every answer is one line, empty where it was done."""

from __future__ import annotations

import math
from collections.abc import Callable

from path_follower.modes import WITHDRAWN, Event, Mode, Phase
from path_follower.params import FollowerParams
from path_follower.path import Location, ReferencePath
from path_follower.reasons import FINE, StopReason, describe
from path_follower.safety import SafetyMonitor
from path_follower.vehicle import Limiter, Motion, Predictor
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import Verdict

OPERATOR, EMERGENCY = Verdict(StopReason.OPERATOR), Verdict(StopReason.EMERGENCY_STOP)


class Arming:
    """A path, a place on it, and whether the vehicle may move; nothing moves before `start`."""

    def __init__(self, params: FollowerParams | None = None, path: ReferencePath | None = None) -> None:
        """Begin at standstill, not armed."""
        self.params = params or FollowerParams()
        self.mode = Mode()
        self._steady_ns: int | None = None  # since when a vehicle that waits could go on
        self.limiter = Limiter(self.params.vehicle)
        self.predictor = Predictor(self.params.vehicle, self.params.actuation)
        self.watch = SafetyMonitor(self.params, self.predictor)
        self.path: ReferencePath | None = None
        self.location: Location | None = None
        if path is not None:
            self.load(path)

    @property
    def heading(self) -> Motion:
        """The motion commanded last; standing, its speed is +-0 by the direction in which the path goes on."""
        last = self.limiter.last
        if last.speed or self.path is None or self.location is None:
            return last
        return Motion(math.copysign(0.0, self.path.segments[self.location.segment].direction), last.steering_angle)

    @property
    def is_standing(self) -> bool:
        """Whether zero is commanded and the actuators are thought to have obeyed."""
        return self.limiter.last.speed == 0.0 and self.predictor.is_standing

    def load(self, path: ReferencePath | None) -> None:
        """Take a path, or none, in standstill and disarmed; ValueError otherwise."""
        if refusal := self.mode.take(Event.CLEAR if path is None else Event.LOAD):
            raise ValueError(f"path: {refusal}")
        self.path, self.location = path, None
        if self.watch.is_emergency:
            self.mode.take(Event.PRESS, EMERGENCY)

    def tune(self, params: FollowerParams) -> None:
        """Go on with other values of the live parameters, also while driving."""
        self.params = self.watch.params = self.watch.consistency.params = params
        if self.path is not None:
            self.path = self.path.at_cruise(params.speed.cruise)

    def see_pose(
        self, T_map_base: SE3, time_ns: int, speed: float | None = None, covariance: Array | None = None
    ) -> None:
        """Accept a pose; `covariance` (3, 3) of (x, y, yaw) in the vehicle's axes, None: not stated."""
        is_driven = not self.mode.is_at_rest and self.mode.phase is not Phase.PAUSED
        self.watch.see_pose(T_map_base, time_ns, speed, covariance, is_driving=is_driven)

    # --- requests
    def under(self, permission: int, request: Callable[[], str | None], *, is_stop: bool = False) -> str:
        """Do what was decided under a permission, by its number, if that has not ended since; a stop in any case."""
        is_valid = permission == self.mode.permission
        try:
            refusal = request() if is_valid or is_stop else None
        except ValueError as error:
            return str(error)
        return refusal or ("" if is_valid else WITHDRAWN)

    def start(self, now_ns: int) -> str:
        """Drive, where the vehicle stands on the path: after a stop at the place reached, else at the closest."""
        return self._go(Event.START, now_ns)

    def resume(self, now_ns: int) -> str:
        """Go on after a pause, or a stop that waits."""
        return self._go(Event.RESUME, now_ns)

    def stop(self) -> str:
        """Brake, and stand until `start`; never refused."""
        return self.mode.take(Event.STOP, OPERATOR)

    def pause(self) -> str:
        """Brake, and stand until `resume`."""
        return self.mode.take(Event.PAUSE, OPERATOR)

    def emergency(self, *, is_pressed: bool) -> None:
        """Brake hard and disarm; a release alone moves nothing."""
        if is_pressed and not self.watch.is_emergency:
            self.mode.take(Event.PRESS, EMERGENCY)
        self.watch.is_emergency = is_pressed

    def stand(self, verdict: Verdict) -> None:
        """Be disarmed, at zero command: the vehicle is left alone, or what it did meanwhile is not known."""
        self.limiter.stand()
        self.predictor.reset()
        self.mode.take(Event.LEAVE, verdict)

    def reset(self) -> None:
        """Forget everything with a stamp, as after a jump of the clock; brake if in motion."""
        self.watch.reset()
        self.predictor.reset()
        self.limiter.last_ns = self._steady_ns = None
        self.mode.take(Event.RESET, Verdict(StopReason.CLOCK_STOPPED, detail="the clock went backwards"))

    def _go(self, event: Event, now_ns: int) -> str:
        """Drive, for one of the events that lead there, if table, inputs and place allow it."""
        refusal = self.mode.refusal(event)
        if refusal or self.mode.is_driving:
            return refusal
        verdict, place = self._find_start(now_ns)
        if verdict is not FINE:
            return describe(verdict)
        self.location = place
        return self.mode.take(event)

    def _find_start(self, now_ns: int) -> tuple[Verdict, Location | None]:
        """Return why a drive cannot begin now, or FINE and where."""
        verdict = self.watch.judge_inputs(now_ns)
        if verdict is not FINE or self.path is None:
            return verdict, None
        return self.watch.find_start(self.path, None if self.mode.has_ended else self.location)
