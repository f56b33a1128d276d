"""The table of states and events, whole: after a stop nothing moves the vehicle but a start that was asked for."""

import itertools

import pytest

from path_follower.arming import EMERGENCY, OPERATOR
from path_follower.modes import Event, FollowerState, Mode, Phase
from path_follower.reasons import FINE, Severity, StopReason, severity_of
from sphere_nav.localization.status import Verdict

# Each cell as the page shows it, written out: imported, a cell that was turned would go unseen.
NO_PATH, IDLE, DRIVING, PAUSED, YIELDING, WAITING, STOPPING, STOPPED, FINISHED = Phase
REFUSED, SAME = "refused", "unchanged"
CELLS = {
    #                NO_PATH  IDLE     DRIVING   PAUSED    YIELDING  WAITING  STOPPING  STOPPED  FINISHED
    Event.START: (REFUSED, DRIVING, SAME, DRIVING, REFUSED, DRIVING, REFUSED, DRIVING, DRIVING),
    Event.RESUME: (REFUSED, REFUSED, REFUSED, DRIVING, REFUSED, DRIVING, REFUSED, REFUSED, REFUSED),
    Event.PAUSE: (REFUSED, REFUSED, PAUSED, SAME, PAUSED, PAUSED, REFUSED, REFUSED, REFUSED),
    Event.STOP: (SAME, SAME, STOPPING, STOPPING, STOPPING, STOPPED, SAME, SAME, SAME),
    Event.PRESS: (SAME, SAME, STOPPING, STOPPING, STOPPING, STOPPED, SAME, SAME, SAME),
    Event.RELEASE: (SAME, SAME, SAME, SAME, SAME, SAME, SAME, SAME, SAME),
    Event.LOAD: (IDLE, SAME, REFUSED, REFUSED, REFUSED, IDLE, REFUSED, IDLE, IDLE),
    Event.CLEAR: (SAME, NO_PATH, REFUSED, REFUSED, REFUSED, NO_PATH, REFUSED, NO_PATH, NO_PATH),
    Event.RESET: (SAME, SAME, STOPPING, STOPPING, STOPPING, STOPPED, SAME, SAME, SAME),
    Event.LEAVE: (SAME, SAME, STOPPED, STOPPED, STOPPED, STOPPED, STOPPED, SAME, SAME),
    Event.MISSING: (SAME, SAME, YIELDING, SAME, SAME, SAME, SAME, SAME, SAME),
    Event.BLOCKED: (SAME, SAME, YIELDING, SAME, SAME, SAME, SAME, SAME, SAME),
    Event.WRONG: (SAME, SAME, STOPPING, SAME, STOPPING, STOPPED, SAME, SAME, SAME),
    Event.BACK: (SAME, SAME, SAME, SAME, DRIVING, DRIVING, SAME, SAME, SAME),
    Event.STANDS: (SAME, SAME, SAME, SAME, WAITING, SAME, STOPPED, SAME, SAME),
    Event.END: (SAME, SAME, FINISHED, SAME, SAME, SAME, SAME, SAME, SAME),
}
MISSING, BLOCKED = Verdict(StopReason.POSE_TIMEOUT), Verdict(StopReason.OBSTACLE)
WRONG, END = Verdict(StopReason.OFF_PATH), Verdict(StopReason.END_OF_PATH)
WHY = {
    Event.STOP: OPERATOR,
    Event.PAUSE: OPERATOR,
    Event.PRESS: EMERGENCY,
    Event.RESET: Verdict(StopReason.CLOCK_STOPPED),
    Event.LEAVE: OPERATOR,
    Event.END: END,
}
FOUND = {Event.MISSING: MISSING, Event.BLOCKED: BLOCKED, Event.WRONG: WRONG}
ENDING = (Event.PAUSE, Event.STOP, Event.PRESS, Event.LOAD, Event.CLEAR, Event.RESET, Event.LEAVE)
ASKED = (Event.START, Event.RESUME)


WAYS = {
    NO_PATH: (),
    IDLE: (Event.LOAD,),
    DRIVING: (Event.LOAD, Event.START),
    PAUSED: (Event.LOAD, Event.START, Event.PAUSE),
    YIELDING: (Event.LOAD, Event.START, Event.MISSING),
    WAITING: (Event.LOAD, Event.START, Event.MISSING, Event.STANDS),
    STOPPING: (Event.LOAD, Event.START, Event.WRONG),
    STOPPED: (Event.LOAD, Event.START, Event.WRONG, Event.STANDS),
    FINISHED: (Event.LOAD, Event.START, Event.END),
}


def mode_in(phase):
    """Return a mode that got into a phase by events."""
    mode = Mode()
    for event in WAYS[phase]:
        happen(mode, event)
    assert mode.phase is phase
    return mode


def happen(mode, event):
    """Let an event happen as the follower does."""
    if event in FOUND:
        mode.halt(FOUND[event])
        return ""
    if event is Event.BACK:  # by `safety.resume`, which lets nothing but what was missing end by itself
        return mode.take(event) if severity_of(mode.verdict) is Severity.MISSING else ""
    return mode.take(event, WHY.get(event, FINE))


@pytest.mark.parametrize("event", Event)
def test_each_state_answers_each_event_as_the_table_says(event):
    for phase, expected in zip(Phase, CELLS[event], strict=True):
        mode = mode_in(phase)
        answer = mode.take(event, FOUND.get(event) or WHY.get(event, FINE))
        assert bool(answer) == (expected == REFUSED), (phase, answer)
        assert mode.phase is (expected if isinstance(expected, Phase) else phase)


@pytest.mark.parametrize("event", Event)
def test_a_permission_ends_with_every_stop_pause_press_path_and_reset_in_every_state(event):
    for phase, expected in zip(Phase, CELLS[event], strict=True):
        mode = mode_in(phase)
        before = mode.permission
        happen(mode, event)
        is_found_wrong = event is Event.WRONG and isinstance(expected, Phase)
        assert (mode.permission > before) == ((event in ENDING and expected != REFUSED) or is_found_wrong), phase


class Watched:
    """A mode, whether a stop was acknowledged since the last request for motion, and whether the stop is pressed."""

    def __init__(self, events=()):
        self.mode, self.is_stopped, self.is_pressed = Mode(), True, False
        for event in events:
            self.happen(event)

    def happen(self, event):
        if event in ASKED and self.is_pressed:
            return  # the inputs do not allow it
        mode, phase, permission = self.mode, self.mode.phase, self.mode.permission
        answer = happen(mode, event)
        self.is_pressed = event is Event.PRESS or (self.is_pressed and event is not Event.RELEASE)
        if not answer and event in (Event.STOP, Event.PAUSE, Event.PRESS, Event.LEAVE, Event.RESET):
            self.is_stopped = True
            assert mode.permission > permission
        if not answer and event in ASKED and phase is not DRIVING:
            self.is_stopped = False

    @property
    def key(self):
        """All that what follows depends on."""
        return self.mode.phase, self.mode.verdict, self.mode.is_stopping_hard, self.is_stopped, self.is_pressed


def test_no_sequence_of_six_events_moves_a_vehicle_that_was_stopped():
    """All 16^6 from each of the 9 states: sequences that have led to the same are gone on with once."""
    reached = {(watched := Watched(events)).key: events for events in WAYS.values()}
    seen = set(reached)
    for _ in range(6):
        following = {}
        for events, event in itertools.product(reached.values(), Event):
            watched = Watched((*events, event))
            assert not (watched.is_stopped and watched.mode.is_driving), (*events, event)
            if watched.is_pressed and watched.mode.phase not in (NO_PATH, IDLE, FINISHED):
                assert watched.mode.verdict is EMERGENCY, (*events, event)
            if watched.key not in seen:
                following[watched.key] = (*events, event)
        seen |= set(following)
        reached = following
    assert len(seen) > 40


def test_the_worst_that_was_found_is_kept_until_the_next_start():
    order = (MISSING, BLOCKED, WRONG, OPERATOR, EMERGENCY)
    for first, second in itertools.permutations(order, 2):
        mode = mode_in(DRIVING)
        for verdict in (first, second):
            mode.take(Event.STOP, verdict) if verdict is OPERATOR else mode.halt(verdict)
        assert mode.verdict is max(first, second, key=order.index)
    mode.settle(is_standing=True)
    assert mode.take(Event.START) == ""
    assert mode.verdict is FINE


def test_a_gentle_stop_becomes_hard_when_a_reason_comes_up_and_a_start_forgets_that():
    for gentle in (Event.STOP, Event.PAUSE):
        mode = mode_in(DRIVING)
        mode.take(gentle, OPERATOR)
        assert not mode.is_stopping_hard
        mode.halt(MISSING)
        assert mode.is_stopping_hard
        assert mode.verdict is OPERATOR
        mode.settle(is_standing=True)
        mode.take(Event.START)
        assert not mode.is_stopping_hard


def test_slow_follows_the_localisation():
    mode = mode_in(DRIVING)
    mode.settle(is_standing=False, slow=BLOCKED)
    assert (mode.state, mode.verdict) == (FollowerState.SLOW, BLOCKED)
    mode.settle(is_standing=False)
    assert (mode.state, mode.verdict) == (FollowerState.DRIVING, FINE)
    mode.settle(is_standing=False, slow=BLOCKED)
    mode.halt(MISSING)
    assert (mode.state, mode.verdict) == (FollowerState.STOPPING, MISSING)


def test_the_words_are_those_of_the_message():
    messages = pytest.importorskip("sphere_nav_msgs.msg")
    for state in FollowerState:
        assert getattr(messages.FollowerStatus, state.value) == state.value
        assert isinstance(getattr(messages.FollowerStatus, f"CODE_{state.value}"), int)


def test_what_is_found_while_nothing_drives_is_no_news():
    for phase in (NO_PATH, IDLE, FINISHED):
        mode = mode_in(phase)
        before = mode.verdict
        mode.halt(MISSING)
        mode.halt(WRONG)
        assert (mode.phase, mode.verdict) == (phase, before)
