"""What is drawn of a localiser's states, and what is said of them."""

from sphere_nav.localization.status import Reason, State, Status
from sphere_nav.offline.plot_figure import describe_states, runs_of

SECOND = 1_000_000_000
STATES = [State.SEARCHING, State.PROBATION, State.TRACKING, State.TRACKING, State.DEGRADED, State.LOST]
REASONS = ["", "", "", "", Reason.LOW_OVERLAP, Reason.TIMEOUT]


def status(number):
    stamp = (number + 1) * SECOND
    return Status(STATES[number], REASONS[number], remedy="turn back", milliseconds=5.0 + number, stamp_ns=stamp)


def test_runs_of_equal_states_last_until_the_next_begins():
    runs = runs_of([status(number) for number in range(6)], SECOND)
    assert [(str(state), str(reason)) for state, reason, _, _ in runs] == [
        ("SEARCHING", ""), ("PROBATION", ""), ("TRACKING", ""), ("DEGRADED", "LOW_OVERLAP"), ("LOST", "TIMEOUT"),
    ]  # fmt: skip
    assert [(first, end) for _, _, first, end in runs] == [(0, 1), (1, 2), (2, 4), (4, 5), (5, 5)]
    assert runs_of([], 0) == []


def test_the_time_for_an_image_leaves_silences_out():
    lines = describe_states([status(number) for number in range(6)])
    assert lines[0] == "     2  TRACKING                      turn back"
    assert lines[-1] == "time for an image: median 7.0 ms, p99 9.0 ms"
