"""Drive by direction instead of a pose (N17 section III-D): turn towards the next waypoint, stop when in doubt.

A direction is worth what a pose is worth: it has a stamp, it ages, and its source says whether it may be trusted. The
guards are those of the follower; there is no path to leave, but a direction too far aside cannot be driven.
"""

from __future__ import annotations

import math

from path_follower.constants import CREEP, MAX_ANGLE, MAX_POSE_AGE
from path_follower.follower import Follower
from path_follower.law import TrackingError
from path_follower.modes import Event
from path_follower.obstacles import points_on_arc, stopping_distance
from path_follower.params import FollowerParams
from path_follower.path import Location, ReferencePath
from path_follower.reasons import FINE, StopReason, blocked, first_of, over
from path_follower.vehicle import clip
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Verdict


class HomingFollower(Follower):
    """Give it directions with `see`, time with `tick`; nothing moves before `start`."""

    def __init__(self, params: FollowerParams | None = None) -> None:
        """Begin at standstill, not armed, not there yet."""
        super().__init__(params)
        self._way = 0.0, 0.0
        self.is_there = False
        self.mode.take(Event.LOAD)

    @property
    def direction(self) -> float | None:
        """Angle in rad from the vehicle's heading to the next waypoint, positive to the left; None before any."""
        pose = self.watch.pose
        return pose.yaw if pose is not None else None

    def see(self, direction: float, time_ns: int) -> None:
        """Accept a direction in rad; one that is no number, or not newer, changes nothing."""
        self.watch.see_pose(SE3.from_planar(0.0, 0.0, direction), time_ns)

    def see_source(self, *, is_trusted: bool, is_there: bool, way: tuple[float, float], now_ns: int) -> None:
        """Take what the source of the directions says of them; `way`: m gone and m left along the path.

        While it says that none is clear the last one holds, slowly, for `safety.max_blind_time`.
        """
        is_blind = now_ns - self.watch.pose_ns > 1e9 * self.params.safety.max_blind_time
        unclear = State.LOST if is_blind else State.DEGRADED
        self.watch.see_status(State.TRACKING if is_trusted or is_there else unclear, now_ns)
        self.is_there = is_there
        self._way = way

    @property
    def way(self) -> tuple[float, float]:
        """Way gone and way left in m, as the source of the directions says."""
        return self._way

    def load(self, path: ReferencePath | None) -> None:
        """Refuse: the path is that of who gives the directions."""
        raise ValueError("path: expected none while driving by direction, found one: give it to mcl_depth")

    def _find_start(self, now_ns: int) -> tuple[Verdict, Location | None]:
        """Return why a drive cannot begin now, or FINE: there is a direction that can be driven."""
        verdict = self._judge(self.watch.judge_inputs(now_ns), None)
        is_over = verdict is FINE and self.is_there
        return (Verdict(StopReason.END_OF_PATH) if is_over else verdict), None

    def _judge(self, inputs: Verdict, tracking: TrackingError | None) -> Verdict:
        """Return the first reason against motion: the inputs, a direction too far aside, something in the way."""
        aside = over(StopReason.OFF_PATH, abs(self.direction or 0.0), MAX_ANGLE)
        distance = stopping_distance(self.limiter.last.speed, self.params)
        count = points_on_arc(self.watch.points, self.limiter.last.steering_angle, distance, self.params)
        return first_of(inputs, aside, blocked(count))

    def _finish_segment(self, tracking: TrackingError | None) -> None:
        """Standing at the end: be finished."""
        if self.is_there and self.limiter.last.speed == 0.0:
            self.mode.take(Event.END, Verdict(StopReason.END_OF_PATH))

    def _law(self, now_ns: int, tracking: TrackingError | None) -> tuple[float, float | None]:
        """Return speed and curvature of the circle that leads to a point ahead in the direction (pure pursuit).

        What was turned since the direction was measured is taken off it.
        """
        if self.direction is None or not self.mode.is_driving:
            return 0.0, None
        age = min(max(now_ns - self.watch.pose_ns, 0) / 1e9, MAX_POSE_AGE)
        turned = self.limiter.last.yaw_rate(self.params.vehicle.virtual_wheelbase) * age
        angle = clip(self.direction - turned, math.pi / 2)
        curvature = 2.0 * math.sin(angle) / self.params.homing.look_ahead
        slow = self.params.speed.slow if self.watch.state == State.DEGRADED else self.params.homing.speed
        if self.is_there:
            return 0.0, curvature
        return max(min(self.params.homing.speed * math.cos(angle), slow), CREEP), curvature
