"""The control loop as a part of the node: what a start begins with, what is repeated, and how long a look took."""

import os
import threading
from multiprocessing import Pipe
from types import SimpleNamespace

import pytest
from sphere_nav_msgs.msg import GuardStatus
from std_msgs.msg import Bool

from path_follower.modes import FollowerState
from path_follower.path import Pose2
from path_follower.reasons import StopReason, describe
from path_follower.ros import front
from path_follower.ros.control import ControlLoop, Cycle
from path_follower.ros.front import LOOP, LoopEnded, RemoteLoop, connected
from path_follower.ros.loop_process import LoopServer
from path_follower.ros.node import PathFollowerNode
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.clocks import SimulatedTicks

REPEAT_NS, SILENCE, TICK = 50_000_000, 0.12, 0.025
MAX_CLOCK_PAUSE = 10.0  # s

SECOND = 1_000_000_000


@pytest.fixture
def bus():
    return OfflineBus()


@pytest.fixture
def loop(bus, kit):
    node = bus.add(PathFollowerNode)
    node.loop.follower.load(kit.make_path([(0, 0), (10, 0)], node.params))
    list(bus.advance(SECOND))
    kit.answer(node.loop.follower, Pose2(0, 0, 0), SECOND)
    return node.loop


def test_all_topics_are_named(loop):
    """What is not named could not be remapped in the process of the loop."""
    opened = {wanted.topic for wanted in loop.endpoints.inputs} - {
        *("/tf", "/tf_static", "reference_path")  # of the front
    }
    assert opened <= set(ControlLoop.TOPICS)


def test_a_start_begins_with_a_zero_command(bus, loop):
    list(bus.settle())
    assert loop.ask("start") == ""
    commands = [item.message for item in bus.settle() if item.topic == "/cmd_vel"]
    assert [(command.linear.x, command.angular.z) for command in commands] == [(0.0, 0.0)]
    assert loop.ask("start") == ""  # it drives: not a second one
    assert not [item for item in bus.settle() if item.topic == "/cmd_vel"]


def test_who_drives_by_a_permission_that_a_stop_has_ended_is_refused(loop):
    refusal, held = loop.ask("drive", "start", loop.follower.mode.permission)
    assert (refusal, loop.follower.mode.state) == ("", FollowerState.DRIVING)
    assert loop.ask("stop") == ""
    assert loop.ask("drive", "resume", held)[0].startswith("the vehicle was stopped")
    with pytest.raises(ValueError, match=r"request: expected one of start, .* found 'fly'"):
        loop.ask("drive", "fly", held)


def test_a_stamp_ahead_of_the_clock_carries_the_loop_on_by_a_tenth_of_a_second_at_most(loop):
    loop.ask("start")
    now = loop.endpoints.own_ns()
    for ahead, counted in ((0, 0), (30_000_000, 30_000_000), (11 * SECOND, 100_000_000)):
        loop.answer(now + ahead)
        assert loop.follower.limiter.last_ns == now + counted


def test_a_guard_that_lets_nothing_through_stops_the_vehicle_by_its_reason(bus, loop):
    assert loop.ask("start") == ""
    bus.deliver("/command_guard/status", GuardStatus(reason="NO_HEARTBEAT", detail="none for more than 0.25 s"))
    assert loop.follower.mode.state is FollowerState.DRIVING
    loop.on_tick()
    loop.follower.tick(SECOND)
    assert loop.follower.mode.verdict.reason is StopReason.COMMAND_GUARD
    assert "NO_HEARTBEAT: none for more than 0.25 s" in describe(loop.follower.mode.verdict)


def test_a_command_is_repeated_between_poses_that_are_far_apart(bus, loop):
    loop.ask("start")
    list(bus.settle())
    loop.heard_ns = loop.endpoints.own_ns()
    loop.on_tick()
    assert not [item for item in bus.settle() if item.topic == "/cmd_vel"]
    loop.sent_ns = loop.endpoints.steady_ns() - 2 * REPEAT_NS
    loop.on_tick()
    assert [item.message.linear.x for item in bus.settle() if item.topic == "/cmd_vel"] == [0.0]


def test_an_emergency_stop_does_not_wait_for_the_looks_that_a_leap_of_the_clock_is_behind(bus, loop, monkeypatch):
    loop.ticks = SimulatedTicks(SILENCE, TICK)
    loop.ask("start")
    loop.answer(SECOND)
    list(bus.settle())
    looks = []

    def take_waiting(wanted):
        looks.append(wanted.topic)
        if len(looks) == 2 * 5:  # what comes by two subscriptions comes before the fifth look
            bus.deliver("/emergency_stop", Bool(data=True))

    monkeypatch.setattr(loop.endpoints, "take_waiting", take_waiting)
    loop.catch_up(11 * SECOND)
    reasons = [item.message.reason for item in bus.settle() if item.topic == "/path_follower/status"]
    assert len(reasons) > 300
    assert reasons[:4] == [""] * 4
    assert set(reasons[4:]) == {StopReason.EMERGENCY_STOP}
    assert set(looks) == {"emergency_stop"}


def test_while_the_clock_stands_the_command_goes_to_zero_and_without_a_publisher_the_permission_ends(
    bus, loop, kit, monkeypatch
):
    assert loop.ask("start") == ""
    for k in range(1, 21):
        list(bus.advance(SECOND + k * SECOND // 20))
        kit.answer(loop.follower, Pose2(0.0, 0.0, 0.0), SECOND + k * SECOND // 20)
    assert loop.follower.limiter.last.speed > 0.3
    loop.heard_ns = loop.endpoints.own_ns()
    clock, steady, publishers = loop.endpoints.now_ns(), loop.endpoints.steady_ns(), ["/cycab_sim"]
    monkeypatch.setattr(loop.endpoints, "publishers_of", lambda topic: publishers if topic == "/clock" else [])

    def look(seconds):
        for k in range(1, round(40 * seconds) + 1):
            monkeypatch.setattr(loop.endpoints, "steady_ns", lambda k=k: steady + k * SECOND // 40)
            loop.on_tick()
        return {item.topic: item.message for item in bus.settle()}

    said = look(4.0)
    assert (said["/cmd_vel"].linear.x, said["/path_follower/status"].reason) == (0.0, "CLOCK_STOPPED")
    assert (loop.endpoints.now_ns(), loop.follower.mode.is_armed) == (clock, True)
    steady, publishers = loop.endpoints.steady_ns(), []
    look(2 * MAX_CLOCK_PAUSE)
    assert not loop.follower.mode.is_armed


def test_a_late_cycle_is_told_for_ten_seconds():
    cycle = Cycle()
    assert cycle.worst == 0.0
    for now in (SECOND, SECOND + 30_000_000, SECOND + 50_000_000):
        cycle.observe(now)
    assert cycle.worst == pytest.approx(0.03)
    for step in range(1, 402):
        cycle.observe(SECOND + 50_000_000 + step * 25_000_000)
    assert cycle.worst == pytest.approx(0.025)


@pytest.fixture
def pair():
    ours, theirs = Pipe()
    yield RemoteLoop(ours), theirs
    theirs.close()


def serve(theirs, *answers):
    """Answer a request after the other; an answer has a number in place of the request's where it says one."""

    def run():
        for answer in answers:
            number, _, _ = theirs.recv()
            theirs.send(answer if len(answer) == 3 else (number, *answer))

    threading.Thread(target=run, daemon=True).start()


def test_a_request_is_answered(pair):
    loop, theirs = pair
    serve(theirs, (True, 5), (False, "path: expected a follower that stands"))
    assert loop.ask("is_at_rest") == 5
    with pytest.raises(ValueError, match="expected a follower that stands"):
        loop.ask("load", "path")


def test_an_answer_that_comes_late_is_not_taken_for_the_next(pair, monkeypatch):
    monkeypatch.setattr(front, "PATIENCE", 0.05)
    loop, theirs = pair
    with pytest.raises(ValueError, match=r"start: no answer of the control loop for 0\.05 s"):
        loop.ask("start")
    number, name, _ = theirs.recv()
    assert name == "start"
    theirs.send((number, True, "late"))
    serve(theirs, (True, "in time"))
    monkeypatch.setattr(front, "PATIENCE", 5.0)
    assert loop.ask("stop") == "in time"


def test_a_loop_that_has_ended_is_told(pair):
    loop, theirs = pair
    theirs.close()
    with pytest.raises(LoopEnded, match="start: the control loop has ended"):
        loop.ask("start")


def test_a_loop_that_is_cleaned_up_commands_zero_and_is_no_publisher_any_more():
    done, server = [], LoopServer(PathFollowerNode, None)
    server.executor = SimpleNamespace(remove_node=lambda shell: done.append("served no more"))
    server.shell = SimpleNamespace(ask=done.append, destroy_node=lambda: done.append("gone"))
    assert server.answer("cleanup", ()) == (True, None)
    assert done == ["deactivate", "served no more", "gone"]


def test_a_front_ends_with_its_loop(monkeypatch):
    """The descriptor that nobody writes tells the end."""
    told = threading.Event()
    monkeypatch.setattr(front.os, "kill", lambda pid, number: told.set())
    life, watched = os.pipe()
    ours, theirs = Pipe()
    monkeypatch.setenv(LOOP, f"{os.dup(ours.fileno())} {life}")
    assert connected() is not None
    assert LOOP not in os.environ
    assert not told.wait(0.05)
    os.close(watched)
    assert told.wait(60.0)
    theirs.close()
