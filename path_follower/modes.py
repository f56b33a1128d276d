"""READ FIRST of stopping. Who may move the vehicle, and when: one owner, one table of what each event leads to.

A permission to move is given by `start`, or by `resume` of what a pause or a wait holds. It ends with each stop, press,
pause, new path and reset. It has a number that changes then: who asks to go on with an older one is refused. While
something is only missing, or in the way, the permission lasts (YIELDING, WAITING); nothing else drives again without
an operator.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from path_follower.reasons import FINE, GENTLE, REMEDIES, Severity, StopReason, severity_of
from sphere_nav.localization.status import Verdict


class FollowerState(enum.StrEnum):
    """The words of FollowerStatus."""

    NO_PATH = "NO_PATH"
    IDLE = "IDLE"
    DRIVING = "DRIVING"
    SLOW = "SLOW"
    PAUSED = "PAUSED"
    STOPPING = "STOPPING"
    STOPPED = "STOPPED"
    FINISHED = "FINISHED"


@dataclass(frozen=True)
class FollowerReport:
    """What the follower does and why; lengths in m."""

    state: FollowerState
    verdict: Verdict
    progress: float
    distance_to_end: float
    is_armed: bool
    permission: int  # the number of the one in force, or of the last

    @property
    def remedy(self) -> str:
        """One line that says what to do."""
        return self.verdict.advise(REMEDIES)


class Phase(enum.Enum):
    """What the table knows: of a stop also whether the permission lasts. The values are what FollowerStatus says."""

    NO_PATH = "NO_PATH"
    IDLE = "IDLE"
    DRIVING = "DRIVING"  # or SLOW
    PAUSED = "PAUSED"
    YIELDING = "STOPPING, permitted"
    WAITING = "STOPPED, permitted"
    STOPPING = "STOPPING"
    STOPPED = "STOPPED"
    FINISHED = "FINISHED"


class Event(enum.StrEnum):
    """What may happen: what an operator asks for, what is found, and what the vehicle does."""

    START = "start"
    RESUME = "resume"
    PAUSE = "pause"
    STOP = "stop"
    PRESS = "emergency stop pressed"
    RELEASE = "emergency stop released"
    LOAD = "path loaded"
    CLEAR = "path removed"
    RESET = "clock jumped"
    LEAVE = "deactivated"
    MISSING = "pose, status or scan missing"
    BLOCKED = "obstacle, or doubt"
    WRONG = "anything else wrong"
    BACK = "what was missing is back"
    STANDS = "the vehicle stands"
    END = "end of the path"


NO_PATH, IDLE, DRIVING, PAUSED, YIELDING, WAITING, STOPPING, STOPPED, FINISHED = Phase
BRAKING, UNLOADED = "the vehicle is still braking", "no path is loaded"
NO_PAUSE, NO_RESUME = "nothing to pause: {state}", "nothing to resume: {state}"
MOVING = "expected a follower that stands, disarmed, found {state}: call stop first"
SLOWLY = Verdict(StopReason.LOCALISATION_DEGRADED, advice="driving slowly until the localiser is TRACKING again")

# Event -> phase -> the next one, or in one line why not. A phase that is not named is left as it is, and that is done.
# START and RESUME come here once the inputs allow motion, BACK where `safety.resume` does.
HALT: dict[Phase, Phase | str] = {DRIVING: STOPPING, PAUSED: STOPPING, YIELDING: STOPPING, WAITING: STOPPED}
WAIT: dict[Phase, Phase | str] = {DRIVING: YIELDING}
REST = {NO_PATH: IDLE, IDLE: IDLE, WAITING: IDLE, STOPPED: IDLE, FINISHED: IDLE}
TABLE: dict[Event, dict[Phase, Phase | str]] = {
    Event.START: {
        NO_PATH: UNLOADED,
        **dict.fromkeys((IDLE, DRIVING, PAUSED, WAITING, STOPPED, FINISHED), DRIVING),
        **dict.fromkeys((YIELDING, STOPPING), BRAKING),
    },
    Event.RESUME: {
        **dict.fromkeys((PAUSED, WAITING), DRIVING),
        YIELDING: BRAKING,
        **dict.fromkeys((NO_PATH, IDLE, DRIVING, STOPPING, STOPPED, FINISHED), NO_RESUME),
    },
    Event.PAUSE: {
        **dict.fromkeys((DRIVING, PAUSED, YIELDING, WAITING), PAUSED),
        **dict.fromkeys((NO_PATH, IDLE, STOPPING, STOPPED, FINISHED), NO_PAUSE),
    },
    Event.STOP: HALT,
    Event.PRESS: HALT,
    Event.RELEASE: {},
    Event.LOAD: {**REST, **dict.fromkeys((DRIVING, PAUSED, YIELDING, STOPPING), MOVING)},
    Event.CLEAR: {
        **dict.fromkeys(REST, NO_PATH),
        **dict.fromkeys((DRIVING, PAUSED, YIELDING, STOPPING), MOVING),
    },
    Event.RESET: HALT,
    Event.LEAVE: {**dict.fromkeys((DRIVING, PAUSED, YIELDING, WAITING, STOPPING), STOPPED)},
    Event.MISSING: WAIT,
    Event.BLOCKED: WAIT,
    Event.WRONG: {DRIVING: STOPPING, YIELDING: STOPPING, WAITING: STOPPED},
    Event.BACK: {YIELDING: DRIVING, WAITING: DRIVING},
    Event.STANDS: {YIELDING: WAITING, STOPPING: STOPPED},
    Event.END: {DRIVING: FINISHED},
}
BEGINS_ANEW = (Event.START, Event.RESUME, Event.BACK, Event.LOAD, Event.CLEAR)  # what was found before counts no more
ENDS_PERMISSION = (Event.PAUSE, Event.STOP, Event.PRESS, Event.LOAD, Event.CLEAR, Event.RESET, Event.LEAVE)
FOUND = {  # the event of what is found, by how bad it is
    Severity.MISSING: Event.MISSING,
    Severity.BLOCKED: Event.BLOCKED,
    Severity.WRONG: Event.WRONG,
    Severity.EMERGENCY: Event.PRESS,
}
WITHDRAWN = "the vehicle was stopped, a path was loaded, or path_follower began anew since"


class Mode:
    """The one owner of whether the vehicle moves: its phase, the worst verdict since it drove, and the permission."""

    def __init__(self) -> None:
        """Begin without a path."""
        self.phase, self.permission = NO_PATH, 0
        self.is_stopping_hard = False  # whether the deceleration of a stop for safety is wanted
        self._worst = self._slow = FINE

    @property
    def state(self) -> FollowerState:
        """The word of FollowerStatus."""
        is_slow = self.phase is DRIVING and self._slow is not FINE
        return FollowerState.SLOW if is_slow else FollowerState(self.phase.value.partition(",")[0])

    @property
    def verdict(self) -> Verdict:
        """Why it does not drive, or drives slowly."""
        return self._slow if self.phase is DRIVING else self._worst

    @property
    def is_armed(self) -> bool:
        """Whether motion is allowed, now or by `resume`."""
        return self.phase in (DRIVING, PAUSED)

    @property
    def is_driving(self) -> bool:
        """Whether the vehicle follows the path."""
        return self.phase is DRIVING

    @property
    def is_at_rest(self) -> bool:
        """Whether neither a drive nor a stop is going on."""
        return self.phase in REST

    @property
    def has_ended(self) -> bool:
        """Whether the next start begins anew, not at the place reached."""
        return self.phase in (IDLE, FINISHED)

    def refusal(self, event: Event) -> str:
        """Return in one line why an event cannot be now; empty where it can."""
        found = TABLE[event].get(self.phase)
        return found.format(state=self.state) if isinstance(found, str) else ""

    def take(self, event: Event, verdict: Verdict = FINE) -> str:
        """Let an event happen, for the reason of a verdict; return why not, empty where it is done."""
        found = TABLE[event].get(self.phase, self.phase)
        if isinstance(found, str):
            return self.refusal(event)
        if event in ENDS_PERMISSION or (event is Event.WRONG and found is not self.phase):
            self.permission += 1
        if event in BEGINS_ANEW:
            self._worst, self._slow, self.is_stopping_hard = FINE, FINE, False
        elif severity_of(verdict) > severity_of(self._worst) or (event is Event.END and found is not self.phase):
            self._worst = verdict
        self.phase = found
        return ""

    def halt(self, verdict: Verdict) -> None:
        """Take what was found against motion; where no drive is going on, or worse was found, it is no news."""
        if self.phase in (NO_PATH, IDLE, FINISHED):
            return
        self.is_stopping_hard = self.is_stopping_hard or verdict.reason not in GENTLE
        if severity_of(verdict) > severity_of(self._worst):
            self.take(FOUND[severity_of(verdict)], verdict)

    def settle(self, *, is_standing: bool, slow: Verdict = FINE) -> None:
        """Follow what the vehicle does: a stop that stands has ended; `slow`: why it drives slowly, else FINE."""
        self._slow = slow
        if is_standing:
            self.take(Event.STANDS)
