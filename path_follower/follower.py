"""READ FIRST. One pose in, one command out: the vehicle follows the reference trajectory (M15 section 6.4.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from path_follower.arming import Arming
from path_follower.constants import CREEP, GOAL_TOLERANCE, SEARCH_WINDOW, STEADY_NS
from path_follower.law import TrackingError, bounded_speed, curvature_law, eased_speed, errors_of, speed_law
from path_follower.modes import SLOWLY, Event, FollowerReport, FollowerState, Phase
from path_follower.reasons import FINE, Severity, StopReason, severity_of
from path_follower.vehicle import Motion, braked
from sphere_nav.localization.status import State, Verdict


@dataclass(frozen=True)
class Command:
    """Speed of the rear axle m/s, its yaw rate rad/s and the angle of the front wheel rad that belong together."""

    stamp_ns: int
    speed: float
    yaw_rate: float
    steering_angle: float
    tracking: TrackingError | None
    status: FollowerReport


class Follower(Arming):
    """Give it poses with `see_pose`, and time with `tick`; nothing moves before `start`."""

    def tick(self, now_ns: int) -> Command:
        """Return the command for now: locate, predict, form the errors, judge, apply the law, limit."""
        tracking = self._track(now_ns)
        inputs = self.watch.judge_inputs(now_ns)
        self._follow_verdict(self._judge(inputs, tracking), now_ns)
        self._finish_segment(tracking)
        speed, curvature = self._law(now_ns, tracking if inputs is FINE else None)
        how = {"is_hard": self.mode.is_stopping_hard, "is_stop": not self.mode.is_driving}
        motion = self.limiter.limit(speed, curvature, now_ns, **how)
        self.predictor.remember(now_ns, motion)
        self.mode.settle(is_standing=motion.speed == 0.0, slow=self._why_slow())
        return self._command(now_ns, motion, tracking, self.report)

    def hold(self, now_ns: int, seconds: float) -> Command:
        """Return the command of a stop that began `seconds` ago because the clock stands; nothing is remembered.

        Where the clock stands, so does the vehicle that it belongs to: when it goes on, so does the drive.
        """
        motion = braked(self.limiter.last, self.params.vehicle.stop_deceleration * seconds)
        verdict = Verdict(StopReason.CLOCK_STOPPED, detail="/clock stands", advice="drives on when the clock does")
        state = FollowerState.STOPPING if motion.speed else FollowerState.STOPPED
        status = self.report if self.mode.is_at_rest else replace(self.report, state=state, verdict=verdict)
        return self._command(now_ns, motion, None, status)

    def _command(self, now_ns: int, motion: Motion, tracking: TrackingError | None, status: FollowerReport) -> Command:
        yaw_rate = motion.yaw_rate(self.params.vehicle.virtual_wheelbase)
        return Command(now_ns, motion.speed, yaw_rate, motion.steering_angle, tracking, status)

    def _why_slow(self) -> Verdict:
        """Return why it drives slowly, where it does for the localisation."""
        doubt = self.watch.doubt.slow
        return FINE if not self.watch.is_slow else SLOWLY if doubt is FINE else doubt

    @property
    def report(self) -> FollowerReport:
        """What it does and why."""
        mode = self.mode
        return FollowerReport(mode.state, mode.verdict, *self.way, mode.is_armed, mode.permission)

    @property
    def way(self) -> tuple[float, float]:
        """Way gone and way left in m."""
        gone = self.location.arc_length if self.location else 0.0
        return gone, self.path.length - gone if self.path is not None else 0.0

    def _track(self, now_ns: int) -> TrackingError | None:
        """Project onto the closest edge, predict, and compare with the virtual vehicle (eq. 22 to 24)."""
        path, pose = self.path, self.watch.pose
        if path is None or pose is None or self.location is None or self.mode.is_at_rest:
            return None
        window = SEARCH_WINDOW + 0.5 * abs(self.predictor.motion.speed)
        here = path.advance(pose, self.location, window)
        # Progress only goes forward: of a vehicle that stands the noise of its poses would add up.
        self.location = replace(here, arc_length=self.location.arc_length) if self.is_standing else here
        predicted = self.predictor.predict(pose, self.watch.pose_ns, now_ns, self.watch.speed)
        ahead = path.advance(predicted, self.location, window)
        virtual = path.at(ahead.arc_length, ahead.segment)
        remaining = path.end_of(ahead.segment) - ahead.arc_length
        return TrackingError(errors_of(predicted, virtual), virtual, self.location, remaining)

    def _judge(self, inputs: Verdict, tracking: TrackingError | None) -> Verdict:
        """Return the first reason against motion."""
        if inputs is not FINE or tracking is None or self.path is None:
            return inputs
        return self.watch.judge_path(self.path, tracking.location, self.limiter.last.speed)

    def _follow_verdict(self, verdict: Verdict, now_ns: int) -> None:
        """Stop for a reason, or end a stop whose reason has gone, by the rule `safety.resume`."""
        self.mode.halt(verdict)
        if self._may_resume(now_ns, is_fine=verdict is FINE):
            self._go(Event.BACK, now_ns)

    def _may_resume(self, now_ns: int, *, is_fine: bool) -> bool:
        """Whether to go on by the rule `safety.resume`: only what was missing may end a stop by its return.

        The rule is never, moving (before standstill) or standing (also after it, once TRACKING holds).
        """
        rule, phase = self.params.safety.resume, self.mode.phase
        may_pass = is_fine and severity_of(self.mode.verdict) is Severity.MISSING and rule != "never"
        if may_pass and phase is Phase.YIELDING:
            return True
        is_steady = may_pass and phase is Phase.WAITING and rule == "standing" and self.watch.state == State.TRACKING
        if not is_steady:
            self._steady_ns = None
        elif self._steady_ns is None:
            self._steady_ns = now_ns
        return self._steady_ns is not None and now_ns - self._steady_ns >= STEADY_NS

    def _finish_segment(self, tracking: TrackingError | None) -> None:
        """Standing at the end of a segment: go on behind the cusp, or be finished."""
        if tracking is None or self.path is None or not self.mode.is_driving:
            return
        if self.is_standing and tracking.remaining <= GOAL_TOLERANCE:
            following = tracking.location.segment + 1
            if following < len(self.path.segments):
                self.location = self.path.begin_of(following)
            else:
                self.mode.take(Event.END, Verdict(StopReason.END_OF_PATH))

    def _law(self, now_ns: int, tracking: TrackingError | None) -> tuple[float, float | None]:
        """Return speed and curvature by eq. 25; no curvature: the wheels stay."""
        if tracking is None or self.path is None:
            return 0.0, None
        curvature = curvature_law(tracking.reference, tracking.errors, self.params.steering, self.limiter.last.speed)
        if not self.mode.is_driving:
            return 0.0, curvature
        speed = speed_law(tracking.reference, tracking.errors.longitudinal)
        is_starting = self.limiter.is_starting(curvature)
        slow = self.params.speed.slow if self.watch.is_slow else self.params.vehicle.max_speed
        coming = eased_speed(self.path, tracking, self.limiter.last, self.limiter.gain, self.params.vehicle)
        slow = min(slow, max(coming, CREEP))
        return bounded_speed(speed, tracking, slow=slow, is_starting=is_starting), curvature
