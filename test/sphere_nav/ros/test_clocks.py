"""Stamps ahead of the clock, stamps on the own clock, and a clock that stands still."""

from types import SimpleNamespace

import pytest

from sphere_nav.ros.clocks import ClockWatch, SimulatedTicks, ahead_s, time_of

# Written out: imported, a change would go unseen.
CLOCK_PATIENCE_S, MAX_AHEAD_NS, MAX_CAUGHT_UP_NS = 0.4, 100_000_000, 10_000_000_000

SECOND = 1_000_000_000
GIVE_UP = 5.0
NOW = 10**12


def stand(watch, clock, begin, seconds):
    for k in range(int(seconds * 40) + 1):
        watch.observe(clock, begin + k * SECOND // 40)
    return begin + int(seconds * SECOND)


def test_a_clock_that_goes_on_was_a_pause_whatever_it_leaps_and_a_process_that_was_not_served_saw_none():
    for leap in (SECOND // 10, SECOND):
        watch = ClockWatch(GIVE_UP)
        now = stand(watch, 5 * SECOND, SECOND, 2.0)
        assert watch.is_standing
        watch.observe(5 * SECOND + leap, now + 1)
        assert not watch.is_standing
        assert not watch.is_over
    watch = ClockWatch(GIVE_UP)
    for k in range(1, 4):  # three looks, 2 s apart, /clock in the queue each time
        watch.observe(5 * SECOND, 2 * k * SECOND)
    assert not watch.is_standing


def test_only_what_is_far_ahead_of_the_clock_counts_and_is_refused_and_nothing_is_younger_than_the_present():
    for lead, expected in [(-(10**12) + 1, 0.0), (0, 0.0), (MAX_AHEAD_NS, 0.0), (3600 * 10**9, 3600.0)]:
        assert ahead_s(NOW + lead, NOW) == expected
    clocks = SimpleNamespace(now_ns=lambda: 100 * SECOND, own_ns=lambda: 7 * SECOND)
    assert time_of(99 * SECOND, clocks) == 6 * SECOND
    assert time_of(100 * SECOND + SECOND // 20, clocks) == 7 * SECOND
    with pytest.raises(ValueError, match=r"expected at most 0\.1 s ahead of the clock, found 3600\.000 s"):
        time_of(3700 * SECOND, clocks)


def test_a_pause_begins_after_four_tenths_of_a_second_by_looks_of_a_tenth():
    watch = ClockWatch(give_up=2.0)
    watch.observe(5 * SECOND, SECOND)
    for k in range(1, 4):
        watch.observe(5 * SECOND, SECOND + k * SECOND)  # looks a second apart count a tenth each
    assert abs(watch.stood - 0.3) < 1e-9
    assert (watch.pause, watch.is_standing) == (0.0, False)
    watch.observe(5 * SECOND, 4 * SECOND + SECOND // 8)
    watch.observe(5 * SECOND, 4 * SECOND + SECOND // 8 + SECOND // 20)
    assert abs(watch.pause - 0.05) < 1e-9
    assert watch.is_standing


def test_a_clock_of_slow_steps_is_called_a_pause_once():
    watch, changes, was_standing = ClockWatch(GIVE_UP), [], False
    for k in range(400):  # 10 s; from 1 s on a step of /clock takes 0.8 s
        watch.observe((5 + max(0, k - 40) // 32) * SECOND, SECOND + k * SECOND // 40)
        changes += [k] if watch.is_standing != was_standing else []
        was_standing = watch.is_standing
    assert len(changes) == 2
    stand(watch, 50 * SECOND, 20 * SECOND, 3.1)  # a real pause is seen all the same
    assert watch.is_standing
    for k in range(1600):  # 40 s of a clock that goes on, and it is as alert as at first
        watch.observe((51 + k) * SECOND, 24 * SECOND + k * SECOND // 40)
    stand(watch, 5000 * SECOND, 64 * SECOND, CLOCK_PATIENCE_S + 0.05)
    assert watch.is_standing


def test_a_clock_that_stands_too_long_is_given_up():
    for give_up, end in ((2.0, 2.0), (0.1, 0.4)):
        watch = ClockWatch(give_up)
        now = stand(watch, 5 * SECOND, SECOND, end - 0.05)
        assert not watch.is_over
        stand(watch, 5 * SECOND, now, 0.1)
        assert watch.is_over


def test_a_clock_that_somebody_publishes_may_stand_for_any_time():
    watch, asked = ClockWatch(give_up=0.0), []

    def has_publisher():
        asked.append(watch.stood)
        return len(asked) < 400

    for k in range(500):
        watch.observe(5 * SECOND, SECOND + k * SECOND // 40, has_publisher)
        assert watch.is_over == (len(asked) >= 400 and watch.abandoned > CLOCK_PATIENCE_S)
    assert watch.is_over  # 0.4 s after the publisher had gone
    assert min(asked) > CLOCK_PATIENCE_S  # while it goes on nobody looks for who publishes it


# --- ticks of simulated time
def ticks_of(looks, messages):
    """Return what happens in a drive whose clock is looked at at some times: ticks, and messages as they come."""
    ticks, done = SimulatedTicks(0.12, 0.025), []
    for now, is_message in sorted([(look, 0) for look in looks] + [(stamp, 1) for stamp in messages]):
        done += [("tick", due) for due in ticks.take(now)]
        if is_message:
            done.append(("message", now))
            ticks.restart(now)
    return done


def test_simulated_time_decides_when_a_node_acts_however_seldom_it_is_served():
    messages = [k * SECOND // 5 for k in range(5, 12)] + [4 * SECOND]
    often = ticks_of(range(SECOND, 4 * SECOND, SECOND // 100), messages)
    assert ticks_of([], messages) == ticks_of([2 * SECOND, 3 * SECOND], messages) == often
    first = [due / SECOND for kind, due in often if kind == "tick" and due < 1.2 * SECOND]
    assert first == [1.12, 1.145, 1.17, 1.195]


def test_the_present_belongs_to_a_message_that_may_still_come_and_a_leap_of_hours_is_not_lived_through():
    ticks = SimulatedTicks(0.12, 0.025)
    ticks.restart(SECOND)
    assert list(ticks.take(SECOND + 120_000_000)) == []
    assert list(ticks.take(SECOND + 120_000_001)) == [SECOND + 120_000_000]
    ticks = SimulatedTicks(0.12, 0.025)
    assert list(ticks.take(0)) == list(ticks.take(SECOND)) == []
    assert list(ticks.take(SECOND + 30_000_000)) == [SECOND, SECOND + 25_000_000]
    assert len(list(ticks.take(3600 * SECOND))) == MAX_CAUGHT_UP_NS // 25_000_000
    ticks.restart(0)
    assert list(ticks.take(5 * SECOND)) == []
