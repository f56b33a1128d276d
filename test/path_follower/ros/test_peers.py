"""Who else there is: an emergency stop that is not heard, two who command, and a guard that lets nothing through."""

import pytest
from sphere_nav_msgs.msg import GuardStatus
from std_msgs.msg import Bool

from path_follower.reasons import FINE, StopReason, describe
from path_follower.ros.peers import Peers

GUARD_SILENCE_NS, HEARD_BEFORE_NS = 500_000_000, 300_000_000

MS = 1_000_000


class Endpoints:
    """Those of a node on a bench: callbacks by topic, publishers as set, a clock by hand."""

    def __init__(self):
        self.now, self.publishers, self.callbacks, self.reports = 10**10, {}, {}, {}

    def steady_ns(self):
        return self.now

    def publishers_of(self, topic):
        return self.publishers.get(topic, [])

    def speakers_of(self, topic):
        return self.publishers_of(topic)

    def hear_always(self, topic, kind, callback):
        self.callbacks[topic] = callback
        return topic, f"{topic} latched"

    def add_subscription(self, topic, kind, callback, profile, is_required):
        self.callbacks[topic] = callback

    def report(self, name, level, message):
        self.reports[name] = (level, message)


@pytest.fixture
def bench():
    bench = Endpoints()
    bench.pressed = []
    bench.peers = Peers(bench, "pose", bench.pressed.append)
    return bench


def guard_says(bench, reason="", detail=""):
    bench.callbacks["command_guard/status"](GuardStatus(reason=reason, detail=detail))


def test_two_publishers_are_named(bench):
    for topic, reason in [
        ("pose", StopReason.POSE_SOURCE),
        ("status", StopReason.STATUS_SOURCE),
        ("cmd_vel", StopReason.COMMAND_SOURCE),
    ]:
        bench.publishers = {topic: ["/a"]}
        bench.peers.look()
        assert bench.peers.judge() is FINE
        bench.publishers[topic] = ["/a", "/b"]
        bench.peers.look()
        verdict = bench.peers.judge()
        assert (verdict.reason, verdict.value, verdict.limit) == (reason, 2, 1)
        assert f"{topic} is published by /a, /b" in describe(verdict)
        assert bench.reports[f"publishers {topic}"][0] == 2


def test_an_emergency_stop_that_was_not_heard_refuses_a_start(bench):
    bench.publishers["emergency_stop"] = ["/button"]
    assert "/button publishes emergency_stop, but nothing of it was heard" in str(bench.peers.begin())
    bench.callbacks["emergency_stop"](Bool(data=False))
    assert bench.pressed == [False]
    assert bench.peers.begin() is FINE


def test_a_button_that_is_exchanged_has_to_be_heard_anew(bench):
    bench.callbacks["emergency_stop"](Bool(data=False))
    bench.now += HEARD_BEFORE_NS - MS  # the first message came a moment before its publisher was seen
    bench.publishers["emergency_stop"] = ["/button"]
    assert bench.peers.begin() is FINE
    bench.now += HEARD_BEFORE_NS + 2 * MS
    bench.publishers["emergency_stop"] = ["/other"]
    assert bench.peers.begin().reason is StopReason.EMERGENCY_STOP


@pytest.mark.parametrize(
    ("names", "found"), [([], "/button publishes it no more"), (["/a", "/b"], "published by /a, /b")]
)
def test_a_button_that_vanishes_or_is_doubled_under_way_stops(bench, names, found):
    bench.publishers["emergency_stop"] = ["/button"]
    bench.callbacks["emergency_stop"](Bool(data=False))
    assert bench.peers.begin() is FINE
    assert bench.peers.judge() is FINE
    bench.publishers["emergency_stop"] = names
    bench.peers.look()
    verdict = bench.peers.judge()
    assert verdict.reason is StopReason.EMERGENCY_STOP
    assert found in verdict.detail


def hear(bench, *pressed):
    for one in pressed:
        bench.callbacks["emergency_stop"](Bool(data=one))
    return bench.pressed[-1]


def test_a_stop_pressed_by_one_that_has_gone_holds_until_another_presses_and_releases(bench):
    bench.publishers["emergency_stop"] = ["/button"]
    assert hear(bench, False) is False
    bench.publishers["emergency_stop"] = ["/button", "/page"]
    assert hear(bench, True, False, False) is True  # the button says what it always says
    bench.publishers["emergency_stop"] = ["/button"]
    bench.peers.look()
    assert hear(bench, False) is True
    assert hear(bench, True, False) is False


def test_who_pressed_or_who_comes_later_releases(bench):
    bench.publishers["emergency_stop"] = ["/page"]
    assert hear(bench, True, False) is False
    assert hear(bench, True) is True
    bench.publishers["emergency_stop"] = []
    bench.peers.look()
    assert bench.pressed[-1] is True
    bench.publishers["emergency_stop"] = ["/other"]
    assert hear(bench, False) is False


def test_a_guard_that_waits_for_zero_does_not_refuse_a_start(bench):
    for reason in ["NO_COMMAND", "WAITS_FOR_ZERO"]:
        guard_says(bench, reason)
        assert bench.peers.begin() is FINE
        bench.now += GUARD_SILENCE_NS + MS
        guard_says(bench, reason, "found")
        verdict = bench.peers.judge()
        assert verdict.reason is StopReason.COMMAND_GUARD
        assert f"{reason}: found" in verdict.detail


def test_a_guard_that_falls_silent_stops(bench):
    guard_says(bench)
    bench.peers.begin()
    bench.now += GUARD_SILENCE_NS
    assert bench.peers.judge() is FINE
    bench.now += MS
    verdict = bench.peers.judge()
    assert (verdict.reason, verdict.limit) == (StopReason.COMMAND_GUARD, 0.5)
    assert verdict.value == pytest.approx(0.501)
