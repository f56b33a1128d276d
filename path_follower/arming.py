"""What the operator may ask of a follower, and what it holds: every answer is one line, empty where it was done.

Whether a stop ends by itself: the rule `safety.resume`.
"""

from __future__ import annotations

import math

from path_follower.consistency import MotionConsistency
from path_follower.constants import STEADY_NS
from path_follower.modes import FollowerState, Mode
from path_follower.params import FollowerParams
from path_follower.path import Location, Pose2, ReferencePath
from path_follower.reasons import FINE, StopReason, StopVerdict
from path_follower.safety import SafetyMonitor
from path_follower.vehicle import Limiter, Motion, Predictor
from sphere_nav.geometry.arrays import Array


class Resumption:
    """Only what was missing may end a stop by its return; what was wrong waits for the call `start`."""

    def __init__(self, rule: str) -> None:
        """`rule`: never, moving (before standstill) or standing (also after it)."""
        self._rule = rule
        self._steady_ns: int | None = None

    def is_due(self, mode: Mode, now_ns: int, *, is_fine: bool, is_tracking: bool) -> bool:
        """Return whether to go on; `is_fine`: nothing speaks against motion, `is_tracking`: localised without doubt."""
        may_pass = is_fine and mode.verdict.may_pass and self._rule != "never"
        if may_pass and mode.state is FollowerState.STOPPING:
            return True
        if not (may_pass and is_tracking and mode.state is FollowerState.STOPPED and self._rule == "standing"):
            self._steady_ns = None
            return False
        if self._steady_ns is None:
            self._steady_ns = now_ns
        return now_ns - self._steady_ns >= STEADY_NS


class Arming:
    """A path, a place on it, and whether the vehicle may move; nothing moves before `start`."""

    def __init__(self, params: FollowerParams | None = None, path: ReferencePath | None = None) -> None:
        """Begin at standstill, not armed."""
        self.params = params or FollowerParams()
        self.watch = SafetyMonitor(self.params)
        self.mode = Mode()
        self.resumption = Resumption(self.params.safety.resume)
        self.limiter = Limiter(self.params.vehicle)
        self.predictor = Predictor(self.params.vehicle, self.params.actuation)
        self.consistency = MotionConsistency(self.params, self.predictor)
        self.path: ReferencePath | None = None
        self.location: Location | None = None
        self.measured_speed: float | None = None
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

    def load(self, path: ReferencePath) -> None:
        """Take a path, in standstill and disarmed; ValueError otherwise."""
        if self.mode.is_armed or self.mode.state is FollowerState.STOPPING:
            raise ValueError(
                f"path: expected a follower that stands, disarmed, found {self.mode.state}: call stop first"
            )
        self.path, self.location = path, None
        self.mode.load()

    def tune(self, params: FollowerParams) -> None:
        """Go on with other values of the live parameters, also while driving."""
        self.params = self.watch.params = self.consistency.params = params
        if self.path is not None:
            self.path = self.path.at_cruise(max(params.speed.cruise, params.speed.creep))

    def see_pose(self, pose: Pose2, time_ns: int, speed: float | None = None, covariance: Array | None = None) -> None:
        """Accept a pose; `covariance` (3, 3) of (x, y, yaw) in the vehicle's axes, None: not stated."""
        if self.watch.see_pose(pose, time_ns):
            self.measured_speed = speed
            is_driven = not self.mode.is_at_rest and self.mode.state is not FollowerState.PAUSED
            self.watch.doubt = self.consistency.see_pose(pose, covariance, time_ns, is_driving=is_driven)

    def start(self, now_ns: int) -> str:
        """Arm, where the vehicle stands on the path: after a stop at the place reached, else at the closest."""
        if self.path is None or self.mode.state is FollowerState.STOPPING:
            return "no path is loaded" if self.path is None else "the vehicle is still braking"
        if self.mode.is_driving:
            return ""
        verdict, place = self.watch.judge_inputs(now_ns), None
        if verdict is FINE:
            verdict, place = self.watch.find_start(self.path, None if self.mode.has_ended else self.location)
        if verdict is not FINE or place is None:
            return str(verdict)
        self.location = place
        self.mode.arm()
        return ""

    def stop(self) -> str:
        """Brake and disarm; never refused."""
        self.mode.halt(StopVerdict(StopReason.OPERATOR))
        return ""

    def pause(self) -> str:
        """Brake and stand until `resume`."""
        self.mode.pause()
        return "" if self.mode.state is FollowerState.PAUSED else f"nothing to pause: {self.mode.state}"

    def resume(self, now_ns: int) -> str:
        """Go on after a pause."""
        if self.mode.state is not FollowerState.PAUSED:
            return f"nothing to resume: {self.mode.state}"
        return self.start(now_ns)

    def emergency(self, *, is_pressed: bool) -> None:
        """Brake hard and disarm; a release alone moves nothing."""
        self.watch.is_emergency = is_pressed

    def stand(self, verdict: StopVerdict) -> None:
        """Be disarmed, at zero command: the vehicle is left alone, or what it did meanwhile is not known."""
        self.limiter.stand()
        self.predictor.reset()
        self.mode.stand(verdict)

    def reset(self) -> None:
        """Forget everything with a stamp, as after a jump of the clock; brake if in motion."""
        self.watch.reset()
        self.predictor.reset()
        self.consistency.reset()
        self.limiter.last_ns = None
        self.mode.halt(StopVerdict(StopReason.CLOCK_STOPPED, detail="the clock went backwards"))
