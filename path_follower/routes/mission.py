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
from dataclasses import dataclass, replace

from path_follower.modes import BRAKING, WITHDRAWN, FollowerState
from path_follower.params import TurningParams
from path_follower.path import Pose2
from path_follower.reasons import SEVERITY, Severity, StopReason
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
from path_follower.routes.course import NO_COURSE, Course, make_course
from path_follower.routes.network import Network, Spot
from path_follower.routes.params import MissionParams
from path_follower.routes.planning import Leg, plan, with_laps
from sphere_nav.localization.status import State

UNDER_WAY = (FollowerState.DRIVING, FollowerState.SLOW, FollowerState.PAUSED, FollowerState.STOPPING)
ON_THE_MOVE = (FollowerState.DRIVING, FollowerState.SLOW)
WAITED_FOR = tuple(reason for reason, severity in SEVERITY.items() if 0 < severity <= Severity.BLOCKED)
RETRIED = (*WAITED_FOR, BRAKING)
SILENT = "no status of path_follower: see that it runs"


class MissionState(enum.StrEnum):
    """The words of NavigatorStatus."""

    IDLE = "IDLE"
    WAITING = "WAITING"
    STARTING = "STARTING"
    DRIVING = "DRIVING"
    STOPPING = "STOPPING"
    PAUSED = "PAUSED"
    HELD = "HELD"
    STAYING = "STAYING"


@dataclass(frozen=True)
class Goal:
    """Where to: a place, or a pose on the network; rounds after that, and s to stay there."""

    place: str = ""
    pose: Pose2 | None = None
    laps: int = 0
    wait: float = 0.0


@dataclass(frozen=True)
class Request:
    """What the follower is asked for: load, clear, start, stop, pause or resume; under which permission; a course."""

    name: str
    permission: int
    course: Course | None = None


@dataclass(frozen=True)
class FollowerView:
    """What the follower says of itself, m and s."""

    state: str = ""
    permission: int = -1
    reason: str = ""
    remedy: str = ""
    progress: float = 0.0
    distance_to_end: float = 0.0
    at: float = 0.0


UNHEARD = FollowerView(at=-math.inf)  # nothing, or nothing that still holds


@dataclass(frozen=True)
class Outcome:
    """How a mission ended, in one line, and how far it drove in m."""

    success: bool
    reason: str
    distance: float


@dataclass(frozen=True)
class MissionRecord:
    """What of a mission survives a restart of its node, as `Mission` and `Course` have it."""

    map_id: str
    closed: tuple[int, ...]
    permission: int
    goal: Goal | None
    laps_left: int
    driven: float
    round_legs: int
    seconds: float
    legs: tuple[Leg, ...]
    change: float
    lead: float


class Mission:
    """One mission at a time; give it what happens, ask it what to do."""

    def __init__(self, network: Network, params: MissionParams, vehicle: TurningParams) -> None:
        """Begin without a mission, all edges open."""
        self.network, self.params, self.vehicle = network, params, vehicle
        self.state, self.reason = MissionState.IDLE, ""
        self.goal: Goal | None = None
        self.outcome: Outcome | None = None  # of a mission that has ended; whoever tells it takes it away
        self.closed: set[int] = set()
        self.blocked: dict[int, float] = {}  # edges with an obstacle, and until when they count as closed
        self.view, self.course = UNHEARD, NO_COURSE
        self.pose: tuple[Pose2, float] | None = None
        self.localizer = "", -math.inf
        self.laps_left, self.driven, self.progress = 0, 0.0, 0.0
        self.permission = 0  # under which it asks
        self._heard = 0, -math.inf  # the newest permission that the follower has told, and when
        self._pending: tuple[Request, float] | None = None
        self._ending: str | None = None  # why the mission ends once the vehicle stands
        self._loaded = NO_COURSE  # the last that the follower was given
        self._is_restored = self._is_paused = False
        self._since = self._retry_at = self._asked_at = 0.0
        self._steady_since: float | None = None
        self._obstacle: tuple[float, float] | None = None  # since when, at which progress

    # --- what happens
    def see_pose(self, pose: Pose2, now: float) -> None:
        """Take a pose."""
        self.pose = (pose, now)

    def see_localizer(self, state: str, now: float) -> None:
        """Take the state of the localiser."""
        self.localizer = (state, now)

    def see_follower(self, view: FollowerView) -> None:
        """Take what the follower says; what was on its way while a request was answered is no news."""
        newest, heard_at = self._heard
        if view.permission < newest and view.at - heard_at < LATE:
            return
        self.view, self._heard = view, (view.permission, view.at)
        if self.state is not MissionState.STARTING and (way := self._way_on(self.course)) is not None:
            self.progress = max(self.progress, way)

    def _has_heard(self, now: float) -> bool:
        return now - self._heard[1] <= MAX_SILENCE

    def _way_on(self, course: Course) -> float | None:
        """Return how far the follower is on a course in m, which it has smoothed; None: it has another path."""
        total, whole = self.view.progress + self.view.distance_to_end, course.length + course.lead
        is_its = course.length > 0.0 and abs(total - whole) < 1.0 + SMOOTHED * whole
        return max(self.view.progress * whole / total - course.lead, 0.0) if is_its and total > 0.0 else None

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
        self.view = UNHEARD  # but for what it said before
        self._heard = max(permission, self._heard[0]), now
        if self.permission == request.permission:
            self.permission = permission
        if request.name == "clear":
            self._conclude(False, self._ending or "", now)
        elif request.name == "load":
            self._loaded = request.course or NO_COURSE
        elif request.name == "pause":
            self._is_paused = True
        elif request.name in ("start", "resume") and self.state in (MissionState.STARTING, MissionState.WAITING):
            self._go(MissionState.DRIVING, now)

    # --- what an operator asks for; every answer is one line, empty where it is done
    def check(self, goal: Goal, now: float) -> None:
        """Raise ValueError for a goal that does not exist, or whose permission cannot be known."""
        self.spots_of(goal)
        if not self._has_heard(now):
            raise ValueError(SILENT)

    def begin(self, goal: Goal, now: float) -> None:
        """Drive to a goal, in place of the one there was; ValueError for one that cannot be."""
        self.check(goal, now)
        is_under_way = self.goal is not None and self.state is not MissionState.IDLE
        self._permit()
        self.goal, self.laps_left, self.driven, self.outcome = goal, goal.laps, 0.0, None
        self._retry_at = 0.0
        self.course, self.progress = NO_COURSE, 0.0
        self._obstacle, self._ending, self._is_restored = None, None, False
        self._go(MissionState.STOPPING if is_under_way else MissionState.WAITING, now)

    def _permit(self) -> None:
        """Take over the permission in force: an operator has just asked for motion."""
        self.permission = self._heard[0]

    def cancel(self, why: str, now: float) -> None:
        """End the mission once the vehicle stands."""
        if self.goal is not None:
            self._ending = why
            self._go(MissionState.STOPPING, now)

    def pause(self, now: float) -> str:
        """Stand until `resume`."""
        if self.state not in (MissionState.DRIVING, MissionState.WAITING, MissionState.STARTING):
            return f"nothing to pause: {self.state}"
        if self._pending is not None and self._pending[0].name in ("start", "resume"):
            return "path_follower is just being started: pause once more"
        if not self._has_heard(now):
            return SILENT
        self._go(MissionState.PAUSED, now, "call resume")
        return ""

    def resume(self, now: float) -> str:
        """Go on after a pause, or after a stop that was looked at."""
        if self.state not in (MissionState.PAUSED, MissionState.HELD):
            return f"nothing to resume: {self.state}"
        if not self._has_heard(now):
            return SILENT
        self._is_restored = False
        self._permit()
        is_paused = self.view.state == FollowerState.PAUSED
        self._go(MissionState.STARTING if is_paused else MissionState.STOPPING, now)
        return ""

    def close(self, name: str, is_closed: bool, now: float) -> None:
        """Close an edge, or open it; a mission that would come to it takes another way. ValueError: unknown edge."""
        edges = {str(edge): edge for edge in self.network.edges}
        if name.lstrip("-") not in edges:
            raise ValueError(f"edge: expected one of {', '.join(edges)}, found {name!r}")
        edge = edges[name.lstrip("-")]
        self.blocked.pop(edge, None)
        (self.closed.add if is_closed else self.closed.discard)(edge)
        is_driven = self.state in (MissionState.DRIVING, MissionState.STARTING)
        if is_closed and is_driven and edge in {leg.edge for leg in self.legs_ahead}:
            self._go(MissionState.STOPPING, now, f"edge {edge} was closed: another way is taken")

    # --- what to do
    def tick(self, now: float) -> Request | None:
        """Return what the follower is to be asked for now; None: nothing, or it has yet to answer."""
        if self._pending is not None:
            if now - self._pending[1] > CALL_PATIENCE:
                self._unanswered(now)
            return None
        if self.goal is None:
            return None
        self._watch_permission(now)
        steps: dict[MissionState, Callable[[float], Request | None]] = {
            MissionState.WAITING: self._wait,
            MissionState.STARTING: self._start,
            MissionState.DRIVING: self._drive,
            MissionState.STOPPING: self._stop,
            MissionState.PAUSED: self._stand,
            MissionState.STAYING: self._stay,
            MissionState.HELD: self._hold,
        }
        request = steps[self.state](now)
        self._pending = (request, now) if request is not None else None
        return request

    def _unanswered(self, now: float) -> None:
        """Give a request up: to stop or to pause is asked for again, all else waits for somebody."""
        self._pending = None
        text = "path_follower does not answer: see that it runs"
        if self.state in (MissionState.STOPPING, MissionState.PAUSED):
            self.reason = text
        else:
            self._go(MissionState.HELD, now, f"{text}, then call resume")

    def _watch_permission(self, now: float) -> None:
        """Hold the mission where its permission has ended; how, the follower says."""
        view = self.view
        if view.permission <= self.permission or self._ending is not None or self._is_restored:
            return
        if view.state == FollowerState.PAUSED and self.state is not MissionState.PAUSED:
            self._go(MissionState.PAUSED, now, "path_follower was paused: call resume")
        elif self.state not in (MissionState.PAUSED, MissionState.HELD, MissionState.STAYING):
            why = f"{view.reason}: {view.remedy}" if view.reason else WITHDRAWN
            self._go(MissionState.HELD, now, f"{why.replace(': call start', '')}: call resume")

    def _hold(self, now: float) -> Request | None:
        """Stand; where somebody has started the follower on this way since, the mission goes on with that."""
        is_started = self.view.permission >= self.permission and self.view.state in ON_THE_MOVE
        if is_started and self._way_on(self.course) is not None:
            self._permit()
            self._go(MissionState.DRIVING, now)
        return None

    def _wait(self, now: float) -> Request | None:
        """Wait until nothing is lacking, or until what is in the way has gone; then plan."""
        if self._is_restored and self.view is not UNHEARD:
            return self._adopt(now)
        if self._obstacle is not None:
            return self._at_obstacle(now)
        if now < self._retry_at:
            return None
        self.reason = self._lacks(now)
        self._steady_since = None if self.reason else now if self._steady_since is None else self._steady_since
        if self.reason or now - (self._steady_since or now) < STEADY:
            return None
        self._leave_course()
        try:
            self.course = self._plan(now)
        except ValueError as error:
            self._conclude(False, str(error), now)
            return None
        if self.course.length < 0.3:
            self._arrive(now)
            return None
        self._go(MissionState.STARTING, now)
        return self._ask("load", self.course)

    def _lacks(self, now: float) -> str:
        """Return what keeps a mission from starting, in one line."""
        state, told_at = self.localizer
        if now - told_at > MAX_SILENCE:
            return "no status of the localiser: see that it runs"
        if state != State.TRACKING:
            return f"the localiser is {state}: wait for TRACKING, or call its relocalize"
        if self.pose is None or now - self.pose[1] > MAX_SILENCE:
            return "no pose: see the localiser and the topic of the pose"
        if now - self.view.at > MAX_SILENCE:
            return SILENT
        return "path_follower is under way" if self.view.state in UNDER_WAY else ""

    def _start(self, now: float) -> Request | None:
        return self._ask("resume" if self.view.state == FollowerState.PAUSED else "start")

    def _ask(self, name: str, course: Course | None = None) -> Request:
        return Request(name, self.permission, course)

    def _drive(self, now: float) -> Request | None:
        view = self.view
        if now - view.at > MAX_SILENCE:
            if now - self._since > MAX_SILENCE:
                self.view = UNHEARD
                self._go(MissionState.HELD, now, "no status of path_follower: see that it runs, then call resume")
        elif view.state == FollowerState.FINISHED and self.progress > self.course.length - 1.0:
            self._arrive(now)
        elif view.state == FollowerState.STOPPED:
            self._stopped(view, now)
        elif view.state in (*ON_THE_MOVE, FollowerState.STOPPING):
            self.reason = f"{view.reason}: {view.remedy}" if view.reason else ""
        elif now - self._since > MAX_SILENCE:
            self._go(MissionState.HELD, now, f"path_follower is {view.state}, it began anew: call resume")
        return None

    def _stopped(self, view: FollowerView, now: float) -> None:
        """The follower has stopped by itself, or somebody has stopped it."""
        text = f"{view.reason}: {view.remedy}"
        if view.reason == StopReason.OBSTACLE:
            if self._obstacle is None or self.progress > self._obstacle[1] + ADVANCED:
                self._obstacle = (now, self.progress)
            advice = f"goes on when it has gone, and looks for another way after {self.params.patience:g} s"
            self._go(MissionState.WAITING, now, f"{view.reason}: {advice}")
            self._retry_at = now + RETRY
        elif view.reason in WAITED_FOR and self.params.is_resuming:
            self._go(MissionState.WAITING, now, text)
        else:
            self._go(MissionState.HELD, now, text.replace("call start", "call resume"))

    def _at_obstacle(self, now: float) -> Request | None:
        """Try again and again; what stays closes the edge that it stands on."""
        since, at = self._obstacle or (now, 0.0)
        if self.progress > at + ADVANCED or self.view.reason != StopReason.OBSTACLE:
            self._obstacle = None
            return None
        if now - since > self.params.patience and self.course.legs:
            way = self.progress + self.vehicle.front + BEHIND_FRONT
            edge = self.course.legs[self.course.leg_at(way)].edge
            self.blocked[edge] = now + self.params.memory
            self._obstacle = None
            self._go(MissionState.WAITING, now, f"edge {edge} is blocked: another way is looked for")
            return None
        if now < self._retry_at:
            return None
        self._retry_at = now + RETRY
        return self._ask("start")

    def _stop(self, now: float) -> Request | None:
        """Bring the vehicle to a stand, then go on with what comes after."""
        if now < self._asked_at + RETRY:
            return self._stand_still(now)
        self._asked_at = now
        return self._ask("stop")

    def _stand_still(self, now: float) -> Request | None:
        """Once the vehicle stands: end, and leave the follower without this way; or look for another one."""
        if self.view is UNHEARD or self.view.state in UNDER_WAY:
            return None
        is_loaded = self._way_on(self._loaded) is not None
        self._leave_course()
        if self._ending is None:
            self._go(MissionState.WAITING, now)
        elif is_loaded:
            self._permit()
            return self._ask("clear")
        else:
            self._conclude(False, self._ending, now)
        return None

    def _leave_course(self) -> None:
        """Add what is driven of a course that is given up, way and laps; without one there is nothing to add."""
        self.laps_left = self._laps_to_go()
        self.driven, self.course, self.progress = self.driven + self.progress, NO_COURSE, 0.0

    def _stand(self, now: float) -> Request | None:
        """Have the follower paused; who starts it after that has asked for the mission to go on."""
        if self._is_paused or self.view.state == FollowerState.PAUSED:
            self._is_paused = True
            return self._hold(now)
        if now < self._asked_at + LATE:
            return None
        self._asked_at = now
        return self._ask("pause")

    def _stay(self, now: float) -> Request | None:
        if self.goal is not None and now - self._since >= self.goal.wait:
            self._conclude(True, "", now)
        return None

    def _arrive(self, now: float) -> None:
        self.driven += self.course.length
        self.course, self.progress, self.laps_left = NO_COURSE, 0.0, 0
        self._go(MissionState.STAYING, now)
        self._stay(now)

    def _refused(self, request: Request, failure: str, now: float) -> None:
        """What the follower would not do: for what is missing it is asked again, all else waits for somebody.

        A vehicle must not drive off because an emergency stop was released.
        """
        if request.name == "clear":
            self._conclude(False, f"{self._ending}; {failure}", now)
        elif self.state is MissionState.PAUSED:
            self._is_paused = request.name == "pause" and (failure == WITHDRAWN or failure.startswith("nothing"))
        elif request.name == "resume":
            self._go(MissionState.PAUSED, now, failure)
        elif self.state is MissionState.STOPPING and self._ending is not None:
            self.reason = failure
        elif request.name == "start" and (failure.partition(":")[0] in RETRIED or "no such service" in failure):
            self._go(MissionState.WAITING, now, failure)
            self._retry_at = now + RETRY
        else:
            failure = failure.replace("call start", "call resume")
            self._go(MissionState.HELD, now, failure if "call resume" in failure else f"{failure}: then call resume")

    def _conclude(self, success: bool, reason: str, now: float) -> None:
        self.outcome = Outcome(success, reason, self.driven + self.progress)
        self.goal, self.course, self._ending, self.progress = None, NO_COURSE, None, 0.0
        self._go(MissionState.IDLE, now)

    def _go(self, state: MissionState, now: float, reason: str = "") -> None:
        self.state, self.reason, self._since = state, reason, now
        self._steady_since, self._asked_at, self._is_paused = None, -1e9, False

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
        self.blocked = {edge: until for edge, until in self.blocked.items() if until > now}
        return self.closed | set(self.blocked)

    def _plan(self, now: float) -> Course:
        """Return the way from where the vehicle is; ValueError with a name for what there is not."""
        assert self.goal is not None
        assert self.pose is not None
        closed, cruise = self.closed_now(now), self.params.cruise
        starts = self.network.locate(self.pose[0], self.params.reach, MAX_TURN)
        if not starts:
            raise ValueError(
                f"no way: expected a vehicle within {self.params.reach:g} m of the network, heading along it"
            )
        while True:
            route = plan(self.network, starts, self.spots_of(self.goal), cruise=cruise, closed=closed)
            whole = with_laps(self.network, route, self.laps_left, cruise=cruise, closed=closed)
            try:
                course = make_course(self.network, whole.legs, self.pose[0], self.vehicle)
            except ValueError:
                starts = [spot for spot in starts if spot.edge != whole.legs[0].edge]
                if not starts:
                    raise
            else:
                round_legs = (len(whole.legs) - len(route.legs)) // max(self.laps_left, 1)
                return replace(course, seconds=whole.seconds, round_legs=round_legs)

    def _laps_to_go(self) -> int:
        """Return how many rounds are left after the goal has been reached once more."""
        if not self.course.round_legs:
            return self.laps_left
        return min((len(self.legs_ahead) - 1) // self.course.round_legs, self.laps_left)

    # --- what is said
    @property
    def legs_ahead(self) -> tuple[Leg, ...]:
        """What is left of the way, from the leg on which the vehicle is."""
        return self.course.legs[self.course.leg_at(self.progress) :]

    @property
    def distance_remaining(self) -> float:
        """Way left in m."""
        return max(self.course.length - self.progress, 0.0)

    @property
    def time_remaining(self) -> float:
        """Driving left in s."""
        return self.course.seconds * self.distance_remaining / max(self.course.length, 1e-9)

    @property
    def next_place(self) -> str:
        """The next named place on the way."""
        for leg in self.legs_ahead:
            edge = self.network.edges[leg.edge]
            _, node = edge.ends(leg.direction)
            is_end = abs(leg.last - (edge.length if leg.direction > 0 else 0.0)) < 1e-6
            if is_end and (name := self.network.name_of(node)):
                return name
        return self.goal.place if self.goal is not None else ""

    # --- over a restart
    def snapshot(self) -> MissionRecord:
        """Return what a mission needs to survive."""
        course, closed = self.course, tuple(sorted(self.closed))
        left = self.permission, self.goal, self.laps_left, self.driven, course.round_legs, course.seconds
        return MissionRecord(self.network.map_id, closed, *left, course.legs, course.change, course.lead)

    def restore(self, record: MissionRecord, now: float) -> None:
        """Go on with a mission of before: driving where the follower still drives that way, else held."""
        self.closed = self.network.edges.keys() & set(record.closed)
        if record.goal is None:
            return
        self.spots_of(record.goal)
        self.goal, self.laps_left, self.driven = record.goal, record.laps_left, record.driven
        self.permission = record.permission
        if record.legs and all(leg.edge in self.network.edges for leg in record.legs):
            kept = {name: getattr(record, name) for name in ("legs", "change", "lead", "seconds", "round_legs")}
            self.course = self._loaded = replace(NO_COURSE, **kept)
        self._is_restored = True
        self._go(MissionState.WAITING, now, "the navigator began anew")

    def _adopt(self, now: float) -> Request | None:
        """Decide by what the follower does."""
        self._is_restored = False
        view, way = self.view, self._way_on(self.course)
        if way is not None and view.permission == self.permission and view.state in UNDER_WAY:
            self.progress = way
            self._go(MissionState.PAUSED if view.state == FollowerState.PAUSED else MissionState.DRIVING, now)
        else:
            self.course = NO_COURSE
            why = "the navigator began anew, and the vehicle stands or was stopped since: call resume"
            self._go(MissionState.HELD, now, why)
        return None
