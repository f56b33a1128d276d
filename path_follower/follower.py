"""READ FIRST. One pose in, one command out: the vehicle follows the reference trajectory (M15 section 6.4.2)."""

from __future__ import annotations

from path_follower.command import Command, TrackingError, status_of
from path_follower.modes import Mode, State
from path_follower.params import FollowerParams
from path_follower.path import Location, Pose2, ReferencePath
from path_follower.safety import FINE, Reason, Verdict, Watch
from path_follower.speed import bounded_speed, speed_law
from path_follower.steering import curvature_law, errors_of
from path_follower.vehicle import Limiter, Predictor


class Follower:
    """Give it poses with `update`, time without poses with `tick`; nothing moves before `start`."""

    def __init__(self, params: FollowerParams | None = None, path: ReferencePath | None = None) -> None:
        """Begin at standstill, not armed."""
        self.params = params or FollowerParams()
        self.watch = Watch(self.params)
        self.mode = Mode()
        self.limiter = Limiter(self.params.vehicle)
        self.predictor = Predictor(self.params.vehicle, self.params.actuation)
        self.path: ReferencePath | None = None
        self.location: Location | None = None
        self.measured_speed: float | None = None
        if path is not None:
            self.load(path)

    # --- one step
    def update(
        self, pose: Pose2, speed: float | None, stamp_ns: int, localization_state: str = "", now_ns: int | None = None
    ) -> Command:
        """Answer a pose of stamp `stamp_ns`; `speed` m/s as measured, None if unknown; an empty state is no news."""
        now_ns = max(stamp_ns, self.limiter.last_ns or stamp_ns) if now_ns is None else now_ns
        if localization_state:
            self.watch.see_status(localization_state, now_ns)
        if self.watch.see_pose(Pose2(*pose), stamp_ns):
            self.measured_speed = speed
        return self.tick(now_ns)

    def tick(self, now_ns: int) -> Command:
        """Return the command for now: locate, predict, form the errors, judge, apply the law, limit."""
        tracking = self._track(now_ns)
        inputs = self.watch.judge_inputs(now_ns)
        self._judge(inputs, tracking)
        self._finish_segment(tracking)
        speed, curvature = self._law(tracking if inputs is FINE else None)
        motion = self.limiter.limit(speed, curvature, now_ns, is_hard=self.mode.is_stopping_hard)
        self.predictor.remember(now_ns, motion)
        self.mode.settle(is_standing=motion.speed == 0.0, is_slow=self.watch.is_slow)
        status = status_of(self.mode, self.path, self.location)
        yaw_rate = motion.yaw_rate(self.params.vehicle.wheelbase)
        return Command(now_ns, motion.speed, yaw_rate, motion.steering_angle, tracking, status)

    def _track(self, now_ns: int) -> TrackingError | None:
        """Project onto the closest edge, predict, and compare with the virtual vehicle (eq. 22 to 24)."""
        path, pose = self.path, self.watch.pose
        if path is None or pose is None or self.location is None or self.mode.is_at_rest:
            return None
        window = self.params.path.search_window + 0.5 * abs(self.predictor.motion.speed)
        self.location = path.advance(pose, self.location, window)
        predicted = self.predictor.predict(pose, self.watch.pose_ns, now_ns, self.measured_speed)
        ahead = path.advance(predicted, self.location, window)
        virtual = path.at(ahead.arc_length + self.params.steering.distance, ahead.segment)
        remaining = path.end_of(ahead.segment) - ahead.arc_length
        return TrackingError(errors_of(predicted, virtual), virtual, self.location, remaining)

    def _judge(self, inputs: Verdict, tracking: TrackingError | None) -> None:
        """Stop for the first reason found."""
        self.mode.halt(inputs)
        if inputs is FINE and tracking is not None and self.path is not None:
            self.mode.halt(self.watch.judge_place(tracking.location))
            self.mode.halt(self.watch.judge_way(self.path, tracking.location, self.limiter.last.speed))

    def _finish_segment(self, tracking: TrackingError | None) -> None:
        """Standing at the end of a segment: go on behind the cusp, or be finished."""
        if tracking is None or self.path is None or not self.mode.is_driving:
            return
        is_standing = self.limiter.last.speed == 0.0 and self.predictor.is_standing
        if is_standing and tracking.remaining <= self.params.safety.goal_tolerance:
            following = tracking.location.segment + 1
            if following < len(self.path.segments):
                self.location = self.path.begin_of(following)
            else:
                self.mode.finish()

    def _law(self, tracking: TrackingError | None) -> tuple[float, float | None]:
        """Return speed and curvature by eq. 25; no curvature: the wheels stay."""
        if tracking is None:
            return 0.0, None
        curvature = curvature_law(tracking.reference, tracking.errors, self.params.steering, self.limiter.last.speed)
        if not self.mode.is_driving:
            return 0.0, curvature
        speed = speed_law(tracking.reference, tracking.errors.longitudinal, self.params.speed)
        is_starting = self.limiter.is_starting(curvature)
        slow = self.params.speed.slow if self.watch.is_slow else self.params.vehicle.max_speed
        return bounded_speed(speed, tracking, self.params, slow=slow, is_starting=is_starting), curvature

    # --- the operator; what is refused says why in one line, what is done returns an empty one
    def load(self, path: ReferencePath) -> None:
        """Take a path, in standstill and disarmed; ValueError otherwise."""
        if self.mode.is_armed or self.mode.state is State.STOPPING:
            raise ValueError(
                f"path: expected a follower that stands, disarmed, found {self.mode.state}: call stop first"
            )
        self.path, self.location = path, None
        self.mode.load()

    def start(self, now_ns: int) -> str:
        """Arm, where the vehicle stands on the path: after a stop at the place reached, else at the closest."""
        if self.path is None or self.mode.state is State.STOPPING:
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

    def stop(self) -> None:
        """Brake and disarm."""
        self.mode.halt(Verdict(Reason.OPERATOR))

    def pause(self) -> str:
        """Brake and stand until `resume`."""
        self.mode.pause()
        return "" if self.mode.state is State.PAUSED else f"nothing to pause: {self.mode.state}"

    def resume(self, now_ns: int) -> str:
        """Go on after a pause."""
        if self.mode.state is not State.PAUSED:
            return f"nothing to resume: {self.mode.state}"
        return self.start(now_ns)

    def emergency(self, *, is_pressed: bool) -> None:
        """Brake hard and disarm; a release alone moves nothing."""
        self.watch.is_emergency = is_pressed

    def reset(self) -> None:
        """Forget everything with a stamp, as after a jump of the clock; brake if in motion."""
        self.watch.reset()
        self.predictor.reset()
        self.limiter.last_ns = None
        self.mode.halt(Verdict(Reason.POSE_TIMEOUT))
