"""What is let through, and what ends in a ramp to zero."""

import itertools
import math

import pytest

from path_follower.guard.guard import Guard
from path_follower.guard.params import GuardParams

PARAMS = GuardParams()
STEP = 0.02


class Bench:
    """A guard on a clock, fed with a command and a heartbeat in every step."""

    def __init__(self, **values):
        self.guard, self.now, self.beat = Guard(GuardParams(**values)), 100.0, 0
        self.speeds, self.rates = [], []

    def run(self, seconds, command=(1.0, 0.2), beats=True):
        """Return the time to the first zero, from the begin of the run; infinite where there is none."""
        begin, zero = self.now, math.inf
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            if command is not None:
                self.guard.see_command(*command, self.now)
            self.beat += beats
            self.guard.see_heartbeat(self.beat, self.now)
            speed, rate = self.guard.pass_on(self.now)
            self.speeds.append(speed)
            self.rates.append(rate)
            zero = min(zero, self.now - begin) if speed == 0.0 else zero
        return zero


@pytest.fixture
def driving():
    bench = Bench()
    bench.run(0.1, (0.0, 0.0))
    bench.run(2.0)
    assert (bench.speeds[-1], bench.rates[-1]) == (1.0, 0.2)
    return bench


def test_nothing_passes_before_a_zero_command():
    bench = Bench()
    bench.run(1.0)
    assert max(bench.speeds) == 0.0
    assert bench.guard.reason == "WAITS_FOR_ZERO"


def test_a_guard_that_is_new_takes_no_heartbeat_that_was_sent_before_for_one():
    bench = Bench()
    bench.run(0.1, (0.0, 0.0), beats=False)  # one and the same count
    assert bench.guard.reason == "NO_HEARTBEAT"
    bench.run(0.5)
    assert (max(bench.speeds), bench.guard.reason) == (0.0, "WAITS_FOR_ZERO")  # zero was commanded too early
    bench.run(0.1, (0.0, 0.0))
    bench.run(0.5)
    assert max(bench.speeds) > 0.0


def test_commands_without_a_heartbeat_do_not_pass(driving):
    assert driving.run(1.0, beats=False) <= PARAMS.deadline + 1.0 / PARAMS.max_deceleration + 2 * STEP
    assert (driving.guard.reason, driving.guard.detail) == ("NO_HEARTBEAT", "none for more than 0.25 s")


def test_an_emergency_stop_stops_at_once(driving):
    driving.guard.is_emergency = True
    assert driving.run(1.0) <= 1.0 / PARAMS.max_deceleration + 2 * STEP
    driving.guard.is_emergency = False
    driving.run(0.2)
    assert (driving.speeds[-1], driving.guard.reason) == (0.0, "WAITS_FOR_ZERO")


def test_a_sender_that_comes_back_must_begin_at_zero(driving):
    driving.run(1.0, None)
    assert driving.run(1.0) == pytest.approx(STEP)
    assert driving.speeds[-1] == 0.0
    driving.run(0.1, (0.0, 0.0))
    driving.run(2.0)
    assert driving.speeds[-1] == 1.0


def test_a_guard_that_brakes_keeps_to_the_curve_and_the_limits(driving):
    driving.run(1.0, None)
    for (before, after), rate in zip(itertools.pairwise(driving.speeds), driving.rates[1:], strict=True):
        assert after - before <= PARAMS.max_acceleration * STEP + 1e-9
        assert before - after <= PARAMS.max_deceleration * STEP + 1e-9
        assert rate == pytest.approx(0.2 * after)


def test_commands_beyond_the_limits_are_cut():
    bench = Bench(max_speed=0.5, max_yaw_rate=0.1)
    bench.run(0.1, (0.0, 0.0))
    bench.run(2.0, (-9.0, 9.0))
    assert (bench.speeds[-1], bench.rates[-1]) == (-0.5, 0.1)


@pytest.mark.parametrize("bad", [(math.nan, 0.0), (1.0, math.inf)])
def test_a_command_that_is_no_number_counts_as_none(driving, bad):
    with pytest.raises(ValueError, match="cmd_vel_in: expected finite numbers"):
        driving.guard.see_command(*bad, driving.now)
    assert driving.run(1.0, None) < 0.6


def test_a_change_of_direction_passes_through_zero(driving):
    driving.run(2.0, (-1.0, 0.0))
    assert all(a * b >= 0.0 for a, b in itertools.pairwise(driving.speeds))
    assert driving.speeds[-1] == -1.0
