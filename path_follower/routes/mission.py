"""READ FIRST of the navigator. A mission: what a vehicle is told to do, and what the follower is asked for next.

Nothing here knows ROS or time: poses, states and answers are handed in, `tick` returns one request to the follower at a
time. The whole remaining way goes to the follower as one path, so that nothing stops at joints; another way means a
stop, a new path, a start. Stops, limits and obstacles are the follower's business.

A mission has no permission of its own: it asks the follower under that of its goal, or of the last `resume`. What was
missing and is back, an obstacle that has gone, another way than one that is blocked: on that it goes on. Where the
permission has ended, because anybody has stopped or paused the vehicle or loaded a path, the mission is HELD.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass

from path_follower.modes import BRAKING, WITHDRAWN, FollowerState
from path_follower.params import FrontParams
from path_follower.path import Pose2
from path_follower.reasons import Severity, StopReason
from path_follower.routes.constants import (
    ADVANCED,
    BEHIND_FRONT,
    CALL_PATIENCE,
    LATE,
    MAX_SILENCE,
    MAX_TURN,
    RETRY,
    SMOOTHED,
    STEADY,
)
from path_follower.routes.network import Network, Spot
from path_follower.routes.params import MissionParams
from path_follower.routes.planning import Leg, Route, make_course, plan, with_laps
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import State

UNDER_WAY = (FollowerState.DRIVING, FollowerState.SLOW, FollowerState.PAUSED, FollowerState.STOPPING)
ON_THE_MOVE = (FollowerState.DRIVING, FollowerState.SLOW)
WAITED_FOR = tuple(reason for reason in StopReason if 0 < reason.severity <= Severity.BLOCKED)
RETRIED = (*WAITED_FOR, BRAKING)
SILENT = "no status of path_follower: see that it runs"
NO_ROUTE = Route(())


class MissionState(enum.StrEnum):
    """The words of NavigatorStatus."""

    IDLE = "IDLE"
    WAITING = "WAITING"
    STARTING = "STARTING"
    DRIVING = "DRIVING"
    STOPPING = "STOPPING"
    PAUSED = "PAUSED"
    HELD = "HELD"


IDLE, WAITING, STARTING, DRIVING, STOPPING, PAUSED, HELD = MissionState
# What may interrupt a state, besides its own step in `Mission.tick`: where it leads to. In a state that is not named it
# changes nothing. Out of PAUSED and HELD leads only what somebody asks for, of the mission or of the follower.
TABLE: dict[str, dict[MissionState, MissionState]] = {
    "begin": {IDLE: WAITING, **dict.fromkeys((WAITING, STARTING, DRIVING, STOPPING, PAUSED, HELD), STOPPING)},
    "cancel": dict.fromkeys((WAITING, STARTING, DRIVING, STOPPING, PAUSED, HELD), STOPPING),
    "pause": dict.fromkeys((WAITING, STARTING, DRIVING), PAUSED),
    "resume": dict.fromkeys((PAUSED, HELD), STOPPING),
    "edge closed": dict.fromkeys((STARTING, DRIVING), STOPPING),
    "start answered": dict.fromkeys((WAITING, STARTING), DRIVING),
    "follower started": dict.fromkeys((PAUSED, HELD), DRIVING),
    "permission ended": dict.fromkeys((WAITING, STARTING, DRIVING, STOPPING), HELD),
    "no answer": dict.fromkeys((WAITING, STARTING, DRIVING), HELD),
}


@dataclass(frozen=True)
class Goal:
    """Where to: a place, or a pose on the network, and rounds after that."""

    place: str = ""
    pose: Pose2 | None = None
    laps: int = 0


@dataclass(frozen=True, eq=False)
class Request:
    """What the follower is asked for: load, clear, start or stop; under which permission; a path."""

    name: str
    permission: int
    route: Route = NO_ROUTE
    points: Array | None = None  # of `make_course`


@dataclass(frozen=True)
class FollowerView:
    """What the follower says of itself, m and s; no state: nothing, or nothing that still holds, but its permission."""

    state: str = ""
    permission: int = 0
    reason: str = ""
    remedy: str = ""
    progress: float = 0.0
    distance_to_end: float = 0.0
    at: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """How a mission ended, in one line, and how far it drove in m."""

    success: bool
    reason: str
    distance: float


class Mission:
    """One mission at a time; give it what happens, ask it what to do."""

    def __init__(self, network: Network, params: MissionParams, vehicle: FrontParams) -> None:
        """Begin without a mission, all edges open."""
        self.network, self.params, self.vehicle = network, params, vehicle
        self.outcome: Outcome | None = None  # of a mission that has ended; whoever tells it takes it away
        self.closed: dict[int, float] = {}  # edges, and until when: for ever by a call, for a while by an obstacle
        self.view = FollowerView(at=-math.inf)
        self.pose: tuple[Pose2, float] | None = None
        self.localizer = "", -math.inf
        self.permission = 0  # under which it asks
        self._pending: tuple[Request, float] | None = None
        self._loaded = NO_ROUTE  # the last that the follower was given
        self._set_out(None)
        self._go(IDLE, 0.0)

    def _set_out(self, goal: Goal | None) -> None:
        """Have nothing driven of the way to a goal, or of none."""
        self.goal, self.laps_remaining = goal, 0 if goal is None else goal.laps
        self.route, self.driven, self.progress = NO_ROUTE, 0.0, 0.0
        self._ending: str | None = None  # why the mission ends once the vehicle stands
        self._obstacle: tuple[float, float] | None = None  # since when, at which progress
        self._retry_at = 0.0

    def _go(self, state: MissionState, now: float, reason: str = "") -> None:
        self.state, self.reason, self._since = state, reason, now
        self._steady_since, self._asked_at = math.inf, -math.inf
        self._is_stopped = False

    def _interrupt(self, event: str, now: float, reason: str = "") -> None:
        if self.state in TABLE[event]:
            self._go(TABLE[event][self.state], now, reason)

    # --- what happens
    def see_pose(self, pose: Pose2, now: float) -> None:
        """Take a pose."""
        self.pose = (pose, now)

    def see_localizer(self, state: str, now: float) -> None:
        """Take the state of the localiser."""
        self.localizer = (state, now)

    def see_follower(self, view: FollowerView) -> None:
        """Take what the follower says; what was on its way while a request was answered is no news."""
        if view.permission < self.view.permission and view.at - self.view.at < LATE:
            return
        self.view = view
        if self.state is not STARTING and (way := self._way_on(self.route)) is not None:
            self.progress = max(self.progress, way)

    def _way_on(self, route: Route) -> float | None:
        """Return how far the follower is on a route in m, which it has smoothed; None: it has another path."""
        total, whole = self.view.progress + self.view.distance_to_end, route.length
        is_its = min(whole, total) > 0.0 and abs(total - whole) < 1.0 + SMOOTHED * whole
        return self.view.progress * whole / total if is_its else None

    def answer(self, request: Request, failure: str, permission: int, now: float) -> None:
        """Take the answer to a request, empty: it was done, and its permission is `permission` now.

        One that was given up counts no more.
        """
        if self._pending is None or self._pending[0] is not request:
            return
        self._pending = None
        if failure:
            self._refused(request, failure, now)
            return
        self.view = FollowerView(permission=max(permission, self.view.permission), at=now)
        if self.permission == request.permission:
            self.permission = permission
        if request.name == "clear" and self._ending is not None:  # no goal has come since
            self._conclude(False, self._ending, now)
        elif request.name == "load":
            self._loaded = request.route
        elif request.name == "stop":
            self._is_stopped = True
        elif request.name == "start":
            self._interrupt("start answered", now)

    # --- what an operator asks for; every answer is one line, empty where it is done
    def check(self, goal: Goal, now: float) -> None:
        """Raise ValueError for a goal that does not exist, or whose permission cannot be known."""
        self.spots_of(goal)
        if now - self.view.at > MAX_SILENCE:
            raise ValueError(SILENT)

    def begin(self, goal: Goal, now: float) -> None:
        """Drive to a goal, in place of the one there was; ValueError for one that cannot be."""
        self.check(goal, now)
        self._permit()
        self._set_out(goal)
        self.outcome = None
        self._interrupt("begin", now)

    def _permit(self) -> None:
        """Take over the permission in force: an operator has just asked for motion."""
        self.permission = self.view.permission

    def cancel(self, why: str, now: float) -> None:
        """End the mission once the vehicle stands."""
        self._ending = why
        self._interrupt("cancel", now)

    def pause(self, now: float) -> str:
        """Stand until `resume`."""
        refusal = self._refusal("pause", now)
        if not refusal and self._pending is not None and self._pending[0].name == "start":
            refusal = "path_follower is just being started: pause once more"
        if not refusal:
            self._interrupt("pause", now, "call resume")
        return refusal

    def resume(self, now: float) -> str:
        """Go on after a pause, or after a stop that was looked at."""
        refusal = self._refusal("resume", now)
        if not refusal:
            self._permit()
            self._interrupt("resume", now)
        return refusal

    def _refusal(self, event: str, now: float) -> str:
        """Return why something cannot be asked for now."""
        if self.state not in TABLE[event]:
            return f"nothing to {event}: {self.state}"
        return SILENT if now - self.view.at > MAX_SILENCE else ""

    def close(self, name: str, is_closed: bool, now: float) -> None:
        """Close an edge, or open it; a mission that would come to it takes another way. ValueError: unknown edge."""
        edges = {str(edge): edge for edge in self.network.edges}
        if name.lstrip("-") not in edges:
            raise ValueError(f"edge: expected one of {', '.join(edges)}, found {name!r}")
        edge = edges[name.lstrip("-")]
        self.closed[edge] = math.inf if is_closed else now
        if is_closed and edge in {leg.edge for leg in self.legs_ahead}:
            self._interrupt("edge closed", now, f"edge {edge} was closed: another way is taken")

    # --- what to do
    def tick(self, now: float) -> Request | None:
        """Return what the follower is to be asked for now; None: nothing, or it has yet to answer."""
        if self._pending is not None:
            if now - self._pending[1] > CALL_PATIENCE:
                self._unanswered(now)
            return None
        self._watch_permission(now)
        steps: dict[MissionState, Callable[[float], None]] = {
            WAITING: self._wait,
            STARTING: self._start,
            DRIVING: self._drive,
            STOPPING: self._stop,
            PAUSED: self._stand,
            HELD: self._hold,
        }
        if self.state is not IDLE:
            steps[self.state](now)
        return None if self._pending is None else self._pending[0]

    def _ask(self, name: str, now: float, route: Route = NO_ROUTE, points: Array | None = None) -> None:
        self._pending, self._asked_at = (Request(name, self.permission, route, points), now), now

    def _unanswered(self, now: float) -> None:
        """Give a request up: to stop is asked for again, all else waits for somebody."""
        self._pending = None
        self.reason = "path_follower does not answer: see that it runs"
        self._interrupt("no answer", now, f"{self.reason}, then call resume")

    def _watch_permission(self, now: float) -> None:
        """Hold the mission where its permission has ended; why, the follower says."""
        view = self.view
        if view.permission <= self.permission or self._ending is not None:
            return
        why = f"{view.reason}: {view.remedy}" if view.reason else WITHDRAWN
        self._interrupt("permission ended", now, _to_resume(why))

    def _hold(self, now: float) -> None:
        """Stand; where somebody has started the follower on this way since, the mission goes with that."""
        is_of_now = self.view.permission >= self.permission and self._way_on(self.route) is not None
        if is_of_now and self.view.state in ON_THE_MOVE:
            self._permit()
            self._interrupt("follower started", now)

    def _wait(self, now: float) -> None:
        """Wait until nothing is lacking, or until what is in the way has gone; then plan."""
        if self._obstacle is not None:
            self._at_obstacle(self._obstacle[0], now)
        elif now >= self._retry_at:
            self.reason = self._lacks(now)
            self._steady_since = math.inf if self.reason else min(self._steady_since, now)
            if now - self._steady_since >= STEADY:
                self._set_off(now)

    def _set_off(self, now: float) -> None:
        """Give the follower the way from here."""
        self._leave_route()
        try:
            self.route, points = self._course(now)
        except ValueError as error:
            self._conclude(False, str(error), now)
            return
        if self.route.length < 0.3:
            self._arrive(now)
        else:
            self._go(STARTING, now)
            self._ask("load", now, self.route, points)

    def _lacks(self, now: float) -> str:
        """Return what keeps a mission from starting, in one line."""
        state, told_at = self.localizer
        if now - told_at > MAX_SILENCE:
            return "no status of the localiser: see that it runs"
        if state != State.TRACKING:
            return f"the localiser is {state}: wait for TRACKING, or call its relocalize"
        if self.pose is None or now - self.pose[1] > MAX_SILENCE:
            return "no pose: see the localiser and the topic of the pose"
        if not self.view.state or now - self.view.at > MAX_SILENCE:
            return SILENT
        return "path_follower is under way" if self.view.state in UNDER_WAY else ""

    def _start(self, now: float) -> None:
        self._ask("start", now)

    def _drive(self, now: float) -> None:
        view, is_new = self.view, now - self._since <= MAX_SILENCE
        if now - view.at > MAX_SILENCE:
            if not is_new:
                self.view = FollowerView(permission=view.permission, at=view.at)
                self._go(HELD, now, f"{SILENT}, then call resume")
        elif view.state == FollowerState.FINISHED and self.progress > self.route.length - 1.0:
            self._arrive(now)
        elif view.state == FollowerState.STOPPED:
            self._stopped(view, now)
        elif view.state in (*ON_THE_MOVE, FollowerState.STOPPING):
            self.reason = f"{view.reason}: {view.remedy}" if view.reason else ""
        elif not is_new:
            self._go(HELD, now, f"path_follower is {view.state}, it began anew: call resume")

    def _stopped(self, view: FollowerView, now: float) -> None:
        """The follower has stopped by itself, or somebody has stopped it."""
        text = f"{view.reason}: {view.remedy}"
        if self._note_obstacle(view.reason, now):
            advice = f"goes on when it has gone, and looks for another way after {self.params.patience:g} s"
            self._go(WAITING, now, f"{view.reason}: {advice}")
            self._retry_at = now + RETRY
        elif view.reason in WAITED_FOR and self.params.is_resuming:
            self._go(WAITING, now, text)
        else:
            self._go(HELD, now, _to_resume(text))

    def _note_obstacle(self, reason: str, now: float) -> bool:
        """Note what keeps the vehicle here, of an obstacle since when it gets no farther; return whether it is one."""
        if reason != StopReason.OBSTACLE:
            self._obstacle = None
        elif self._obstacle is None or self.progress > self._obstacle[1] + ADVANCED:
            self._obstacle = now, self.progress
        return self._obstacle is not None

    def _at_obstacle(self, since: float, now: float) -> None:
        """Try again and again; what stays closes the edge that it stands on."""
        if now - since > self.params.patience and self.route.legs:
            at = self.route.leg_at(self.progress + self.vehicle.front + BEHIND_FRONT)
            edge = self.route.legs[at].edge
            self.closed[edge] = max(self.closed.get(edge, now), now + self.params.memory)
            self._obstacle = None
            self._go(WAITING, now, f"edge {edge} is blocked: another way is looked for")
        elif now >= self._retry_at:
            self._retry_at = now + RETRY
            self._ask("start", now)

    def _stop(self, now: float) -> None:
        """Bring the vehicle to a stand, then go on with what comes after."""
        if now >= self._asked_at + RETRY:
            self._ask("stop", now)
        elif self.view.state and self.view.state not in UNDER_WAY:
            self._leave_vehicle(now)

    def _leave_vehicle(self, now: float) -> None:
        """Where the vehicle stands: end, and leave the follower without this way; or look for another one."""
        is_loaded = self._way_on(self._loaded) is not None
        self._leave_route()
        if self._ending is None:
            self._go(WAITING, now)
        elif is_loaded:
            self._permit()
            self._ask("clear", now)
        else:
            self._conclude(False, self._ending, now)

    def _leave_route(self) -> None:
        """Add what is driven of a route that is given up, way and laps; without one there is nothing to add."""
        if self.route.round_legs:
            self.laps_remaining = min((len(self.legs_ahead) - 1) // self.route.round_legs, self.laps_remaining)
        self.driven, self.route, self.progress = self.driven + self.progress, NO_ROUTE, 0.0
        self._obstacle = None

    def _stand(self, now: float) -> None:
        """Have the follower stopped; who starts it after that has asked for the mission to go on."""
        if self._is_stopped:
            self._hold(now)
        elif now >= self._asked_at + LATE:
            self._ask("stop", now)

    def _arrive(self, now: float) -> None:
        self.progress = self.route.length
        self._leave_route()
        self._conclude(True, "", now)

    def _refused(self, request: Request, failure: str, now: float) -> None:
        """What the follower would not do: for what is missing it is asked again, all else waits for somebody.

        A vehicle must not drive off because an emergency stop was released.
        """
        why = failure.partition(":")[0]
        if request.name == "clear" and self._ending is not None:
            self._conclude(False, f"{self._ending}; {failure}", now)
        elif self._ending is not None or self.state is PAUSED:
            self.reason = failure
        elif request.name == "start" and (why in RETRIED or "no such service" in failure):
            self._note_obstacle(why, now)
            self._go(WAITING, now, failure)
            self._retry_at = now + RETRY
        else:
            self._go(HELD, now, _to_resume(failure))

    def _conclude(self, success: bool, reason: str, now: float) -> None:
        self.outcome = Outcome(success, reason, self.driven + self.progress)
        self._set_out(None)
        self._go(IDLE, now)

    # --- the way
    def spots_of(self, goal: Goal) -> list[Spot]:
        """Return where on the network a goal is; ValueError for one that is not there."""
        if goal.place or goal.pose is None:
            return self.network.spots_of(self.network.node_of(goal.place))
        spots = self.network.locate(goal.pose, self.params.reach, MAX_TURN)
        if not spots:
            expected = f"one within {self.params.reach:g} m of the network, heading along it"
            raise ValueError(f"pose: expected {expected}, found x {goal.pose.x:.2f}, y {goal.pose.y:.2f}")
        return spots[:1]

    def closed_now(self, now: float) -> set[int]:
        """Return the edges that are closed, by a call or by an obstacle."""
        return {edge for edge, until in self.closed.items() if until > now}

    def here(self) -> list[Spot]:
        """Return where on the network the vehicle is; ValueError where no pose has come."""
        if self.pose is None:
            raise ValueError("start: expected a place, or a pose of the vehicle, found neither")
        return self.network.locate(self.pose[0], self.params.reach, MAX_TURN)

    def way(self, starts: list[Spot], goal: Goal, laps: int, now: float) -> Route:
        """Return the way to a goal and rounds from there, as edges are open now; ValueError for no way."""
        closed, cruise = self.closed_now(now), self.params.cruise
        route = plan(self.network, starts, self.spots_of(goal), cruise=cruise, closed=closed)
        return with_laps(self.network, route, laps, cruise=cruise, closed=closed)

    def _course(self, now: float) -> tuple[Route, Array]:
        """Return the way from where the vehicle is, and its path; ValueError with a name for what there is not."""
        assert self.goal is not None
        starts = self.here()
        if not starts:
            expected = f"a vehicle within {self.params.reach:g} m of the network, heading along it"
            raise ValueError(f"no way: expected {expected}")
        route = self.way(starts, self.goal, self.laps_remaining, now)
        return route, make_course(self.network, route)

    # --- what is said, by the names of NavigatorStatus
    @property
    def place(self) -> str:
        """Where to."""
        return "" if self.goal is None else self.goal.place

    @property
    def legs_ahead(self) -> tuple[Leg, ...]:
        """What is left of the way, from the leg on which the vehicle is."""
        return self.route.legs[self.route.leg_at(self.progress) :]

    @property
    def edge(self) -> str:
        """The edge under way."""
        return str(self.legs_ahead[0].edge) if self.route.legs else ""

    @property
    def distance_remaining(self) -> float:
        """Way left in m."""
        return max(self.route.length - self.progress, 0.0)

    @property
    def time_remaining(self) -> float:
        """Driving left in s."""
        return self.route.seconds * self.distance_remaining / max(self.route.length, 1e-9)

    @property
    def next_place(self) -> str:
        """The next named place on the way."""
        names = (self.network.name_of(self.network.node_at(leg.edge, leg.last)) for leg in self.legs_ahead)
        return next(filter(None, names), self.place)


def _to_resume(text: str) -> str:
    """Return what the follower advises, as somebody has to do it who wants the mission to go on."""
    text = text.replace("call start", "call resume")
    return text if "call resume" in text else f"{text}: then call resume"
