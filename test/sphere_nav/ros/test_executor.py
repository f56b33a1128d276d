"""Whatever a callback raises, of ours or of rclpy, the same callback is served again and the process goes on."""

import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from sphere_nav.params import param, parameters
from sphere_nav.ros import qos
from sphere_nav.ros.endpoints import ERROR, OK
from sphere_nav.ros.executor import CallbackFailures, GuardedExecutor
from sphere_nav.ros.node import ManagedNode
from worlds.desk import Desk, ShellDesk

MAX_WAITS, RECENT_S = 50, 10.0  # written out: imported, a change would go unseen


class Lines:
    """A log that keeps its lines, each as often as it was given."""

    def __init__(self):
        self.lines = []

    def error(self, text, *, every=0.0, key=""):
        self.lines.append(text)


@parameters
class EchoParams:
    gain: float = param(1.0, "a factor", low=0.0, is_live=True)
    file: str = param("good", "a file")


class Echo(ManagedNode):
    NAME = "echo"
    PARAMS = EchoParams

    def configure(self):
        self.output = self.add_publisher("answer", Int32, qos.STATE)
        self.add_subscription("number", Int32, lambda message: self.output.publish(message), qos.STATE)
        self.add_subscription("latched", Int32, self.on_latched, qos.LATCHED, is_required=False)
        self.latched = []

    def on_latched(self, message):
        self.latched.append(message.data)
        raise OverflowError(message.data)


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


# --- a whole node, and what rclpy opens for it
class Echoed(ShellDesk):
    def __init__(self, **values):
        super().__init__(Echo, **values)
        self.clients, self.heard = {}, []
        self.peer.create_subscription(Int32, "answer", lambda message: self.heard.append(message.data), 10)
        self.numbers = self.peer.create_publisher(Int32, "number", 10)

    def ask(self, kind, name, request):
        """Return the answer; a client that is made where its like has just gone is at times never matched."""
        if name not in self.clients:
            self.clients[name] = self.peer.create_client(kind, f"echo/{name}")
        self.until(self.clients[name].service_is_ready)
        return self.done(self.clients[name].call_async(request))

    def works(self, number):
        def prod():
            self.numbers.publish(Int32(data=number))
            return number in self.heard

        self.until(prod)
        return True


@pytest.fixture
def make_desk(open_desk):
    def make(**values):
        desk = open_desk(Echoed, **values)
        assert desk.shell.start() or not values.get("autostart", True)
        return desk

    return make


def typed(name, kind, **value):
    return Parameter(name=name, value=ParameterValue(type=kind, **value))


def test_a_parameter_of_no_type_is_refused_in_words(make_desk):
    desk, kind = make_desk(), 77
    odd, good = typed("gain", kind), typed("gain", 3, double_value=2.5)
    answer = desk.ask(SetParameters, "set_parameters", SetParameters.Request(parameters=[odd, good]))
    assert [result.successful for result in answer.results] == [False, True]
    assert answer.results[0].reason == f"gain: {kind} is not a valid Parameter.Type"
    request = SetParametersAtomically.Request(parameters=[good, odd])
    answer = desk.ask(SetParametersAtomically, "set_parameters_atomically", request)
    assert (answer.result.successful, str(kind) in answer.result.reason) == (False, True)
    assert desk.works(kind)
    assert (desk.shell.node.params.gain, desk.executor.failures.num_failed) == (2.5, 0)


def test_the_choice_of_the_clock_is_fixed_while_the_node_is_configured(make_desk):
    desk = make_desk(autostart=False)
    clock = desk.peer.create_publisher(Clock, "/clock", 10)

    def choose(value):
        request = SetParametersAtomically.Request(parameters=[typed("use_sim_time", 1, bool_value=value)])
        return desk.ask(SetParametersAtomically, "set_parameters_atomically", request).result

    assert choose(True).successful
    clock_of = desk.shell.get_clock
    assert clock_of().ros_time_is_active
    assert choose(False).successful
    desk.shell.trigger_configure()
    refused = choose(True)
    assert not refused.successful
    assert refused.reason.startswith("use_sim_time: fixed while the node is configured")
    assert not clock_of().ros_time_is_active
    assert clock.get_subscription_count() == 0
    assert not desk.shell.get_parameter("use_sim_time").value
    mixed = [typed("gain", 3, double_value=2.0), typed("use_sim_time", 1, bool_value=True)]
    request = SetParametersAtomically.Request(parameters=mixed)
    assert not desk.ask(SetParametersAtomically, "set_parameters_atomically", request).result.successful
    assert not clock_of().ros_time_is_active
    desk.shell.trigger_cleanup()
    assert choose(True).successful
    assert clock_of().ros_time_is_active


def test_a_latched_message_that_cannot_be_used_does_not_undo_the_start(make_desk):
    desk = make_desk(autostart=False)
    latched = desk.peer.create_publisher(Int32, "latched", qos.LATCHED)
    desk.shell.trigger_configure()
    latched.publish(Int32(data=4))
    desk.until(lambda: any(wanted.kept for wanted in desk.shell.node.inputs))
    desk.shell.trigger_activate()
    assert desk.works(1)
    assert desk.shell.node.latched == [4]
    assert desk.executor.failures.last_failure.startswith("subscription latched: OverflowError: 4")
