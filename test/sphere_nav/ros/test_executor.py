"""Whatever a callback raises, of ours or of rclpy, the same callback is served again and the process goes on."""

import pytest
from rclpy.task import Future
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from sphere_nav.ros.endpoints import ERROR, OK
from sphere_nav.ros.executor import CallbackFailures, GuardedExecutor
from worlds.desk import Desk

MAX_WAITS, RECENT_S = 50, 10.0  # written out: imported, a change would go unseen


class Lines:
    """A log that keeps its lines, each as often as it was given."""

    def __init__(self):
        self.lines = []

    def error(self, text, *, every=0.0, key=""):
        self.lines.append(text)


@pytest.fixture
def failures():
    return CallbackFailures(Lines())


@pytest.fixture
def bare(open_desk, failures):
    """A plain node in the guarded executor."""
    return open_desk(Desk, executor=GuardedExecutor(failures))


# --- each kind of callback
ERRORS = [ValueError("one"), ZeroDivisionError(), OverflowError("big"), MemoryError(), KeyError("x")]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_a_callback_of_any_kind_is_called_again_after_it_raised(bare, failures, error):
    node, executor = bare.peer, bare.executor
    calls = {"timer": 0, "subscription": 0, "service": 0, "guardcondition": 0, "task": 0}

    def fail(kind, *passed):
        calls[kind] += 1
        raise error

    node.create_timer(0.01, lambda: fail("timer"))
    node.create_subscription(Int32, "number", lambda message: fail("subscription"), 10)
    node.create_service(Trigger, "act", lambda request, response: fail("service"))
    condition = node.create_guard_condition(lambda: fail("guardcondition"))
    numbers, client = node.create_publisher(Int32, "number", 10), node.create_client(Trigger, "act")
    bare.until(lambda: numbers.get_subscription_count() and client.service_is_ready())

    def prod():
        numbers.publish(Int32())
        client.call_async(Trigger.Request())
        condition.trigger()
        executor.create_task(lambda: fail("task"))
        return min(calls.values()) >= 3

    bare.until(prod)
    assert failures.num_failed == sum(calls.values())
    texts = [line for line in failures._log.lines if line.startswith("callback failed: ")]
    assert {text.split(": ")[1].split(" ")[0] for text in texts} == {*calls}
    assert all("\n" not in text for text in texts)
    traced = [line for line in failures._log.lines if line.startswith("Traceback")]
    assert len(traced) == len(calls)  # of each, once


def test_a_message_that_cannot_be_taken_leaves_its_topic_and_its_group_in_service(bare, monkeypatch):
    """rclpy marks an entity as busy before it takes the message, and leaves it so where that raises."""
    node, executor, heard = bare.peer, bare.executor, []
    node.create_subscription(Int32, "number", lambda message: heard.append(message.data), 10)
    numbers = node.create_publisher(Int32, "number", 10)
    bare.until(numbers.get_subscription_count)
    take, is_broken = executor._take_subscription, [True]

    def take_badly(subscription):
        found = take(subscription)
        if is_broken:
            is_broken.clear()
            raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")
        return found

    monkeypatch.setattr(executor, "_take_subscription", take_badly)
    for number in (1, 2):
        numbers.publish(Int32(data=number))
    bare.until(lambda: heard)
    assert heard == [2]
    assert "subscription /number: 'utf-8' codec" in executor.failures.last_failure


@pytest.mark.slow
def test_a_wait_that_fails_is_tried_again_and_one_that_always_fails_ends_the_loop(bare, monkeypatch):
    node, executor, ticks = bare.peer, bare.executor, []
    node.create_timer(0.001, lambda: ticks.append(1))
    wait, broken = executor.wait_for_ready_callbacks, [1] * (MAX_WAITS - 1)

    def wait_badly(*args):
        if broken:
            broken.pop()
            raise RuntimeError("no wait set")
        return wait(*args)

    monkeypatch.setattr(executor, "wait_for_ready_callbacks", wait_badly)
    bare.until(lambda: ticks)
    broken += [1] * 2 * MAX_WAITS
    executor.spin_until(Future())
    assert len(broken) == MAX_WAITS
    assert executor.failures.last_failure.startswith("waiting for messages: RuntimeError: no wait set")


# --- what the diagnostics make of it
def test_level_and_line_of_the_diagnostics():
    now = [100.0]
    failures = CallbackFailures(Lines(), lambda: now[0])
    assert failures.examine() == (OK, "all callbacks succeed", {"failed": 0, "last": ""})
    failures.guard(lambda: 1 / 0, "part")
    assert failures.examine()[1].startswith("part: ZeroDivisionError: ")
    failures.add(ValueError("bad"), "timer")
    now[0] += RECENT_S - 0.1
    level, text, values = failures.examine()
    assert (level, text.startswith("timer: bad ("), values["failed"]) == (ERROR, True, 2)
    now[0] += 0.1
    values = {"failed": 2, "last": failures.last_failure}
    assert failures.examine() == (OK, "all callbacks succeed", values)
