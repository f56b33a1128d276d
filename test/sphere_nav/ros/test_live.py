"""A node over real DDS: lifecycle, messages, services, parameters, and what it says when nothing comes."""

import time
from functools import partial

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger

from sphere_nav.params import param, parameters
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import ns_to_time
from sphere_nav.ros.node import WARN, ManagedNode
from sphere_nav.ros.shared_files import software
from worlds.desk import ShellDesk


@parameters
class DoublerParams:
    factor: int = param(2, "what a number is multiplied by", low=1, high=9)
    gain: float = param(0.5, "another factor", low=0.0, is_live=True)
    file: str = param("good", "file to open")
    map: str = param("hall", "what it works on")


class Doubler(ManagedNode):
    NAME = "doubler"
    PARAMS = DoublerParams
    params: DoublerParams

    def configure(self):
        if self.params.file != "good":
            raise ValueError("file: expected good, found bad")
        self.jumps, self.ticks, self.is_clean, self.latched = 0, 0, False, []
        self.output = self.add_publisher("doubled", Int32, qos.LATCHED)
        self.add_subscription("number", Int32, self.on_number, qos.STATE)
        self.add_subscription("hint", Int32, lambda message: None, qos.STATE, is_required=False)
        self.add_subscription("latched", String, self.on_latched, qos.LATCHED, silence=0.0)
        self.add_service("~/reset", Trigger, self.on_reset)
        self.add_timer(0.05, self.on_tick)

    def cleanup(self):
        self.is_clean = True

    def clock_jumped(self):
        self.jumps += 1

    def on_tick(self):
        self.ticks += 1

    def on_latched(self, message):
        self.latched.append(message.data)
        if message.data == "bad":
            raise OverflowError(message.data)

    def on_number(self, message):
        if message.data < 0:
            raise ValueError(f"number: expected 0 or more, found {message.data}")
        self.report("sign", WARN, "number is small", number=message.data)
        self.output.publish(Int32(data=message.data * self.params.factor))

    def on_reset(self, request, response):
        response.success = True
        return response


class Doubled(ShellDesk):
    def __init__(self, **values):
        super().__init__(Doubler, **values)
        self.statuses, self.doubled, self.said = {}, [], []
        self.peer.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, 10)
        self.peer.create_subscription(Int32, "doubled", lambda m: self.doubled.append(m.data), qos.LATCHED)
        self.numbers, self.setters = self.peer.create_publisher(Int32, "number", 10), {}

    def set(self, kind, name, *parameters):
        """Return the answer; a client that is made where its like has just gone is at times never matched."""
        if name not in self.setters:
            self.setters[name] = self.peer.create_client(kind, f"doubler/{name}")
        self.until(self.setters[name].service_is_ready)
        return self.done(self.setters[name].call_async(kind.Request(parameters=parameters)))

    def set_at_once(self, *parameters):
        return self.set(SetParametersAtomically, "set_parameters_atomically", *parameters).result

    def on_diagnostics(self, message):
        self.statuses |= {status.name: status for status in message.status}
        self.said += [f"{status.name}: {status.message}" for status in message.status]

    def send(self, number):
        self.until(lambda: self.numbers.get_subscription_count() > 0)
        self.numbers.publish(Int32(data=number))

    def text(self, name):
        status = self.statuses.get(f"doubler: {name}")
        return status.message if status else ""


@pytest.fixture
def make_desk(open_desk):
    return partial(open_desk, Doubled)


def test_messages_and_diagnostics(make_desk):
    desk = make_desk(factor=3)
    assert desk.shell.start()
    desk.send(14)
    desk.until(lambda: desk.doubled == [42])
    desk.until(lambda: desk.text("sign"))
    status = desk.statuses["doubler: sign"]
    assert (status.level, status.message) == (DiagnosticStatus.WARN, "number is small")
    assert {pair.key: pair.value for pair in status.values} == {"number": "14"}
    assert desk.text("lifecycle") == "active"
    desk.until(lambda: desk.text("input number") == "receiving")


def test_one_line_says_what_a_node_waits_for_and_one_when_it_is_ready(make_desk, monkeypatch):
    desk, lines = make_desk(), {}
    monkeypatch.setattr(desk.shell.log, "info", lambda text, *, every=0.0, key="": lines.setdefault(key, text))
    monkeypatch.setattr(desk.node, "lack", lambda: "" if len(desk.doubled) else "a map (set `map`)")
    assert desk.shell.start()
    desk.until(lambda: lines)
    sent = f"{software()}; map hall; reads /number, /latched; sends /doubled"
    assert lines == {"waits for a map (set `map`)": f"waits for a map (set `map`): {sent}"}
    desk.send(14)
    latched = desk.peer.create_publisher(String, "latched", qos.LATCHED)
    latched.publish(String())
    desk.until(lambda: "ready" in lines)
    assert lines["ready"].startswith("ready: sphere_nav ")
    assert lines["ready"].endswith("reads /number, /latched; sends /doubled")


def test_the_lifecycle_is_that_of_ros(make_desk):
    desk = make_desk(autostart=False)
    assert desk.shell.start()
    client = desk.peer.create_client(ChangeState, "doubler/change_state")
    desk.until(client.service_is_ready)

    def change(transition):
        return desk.done(client.call_async(ChangeState.Request(transition=Transition(id=transition)))).success

    assert desk.shell.node.inputs == []
    assert change(Transition.TRANSITION_CONFIGURE)
    desk.send(1)
    desk.until(lambda: desk.text("lifecycle") == "inactive")
    assert (desk.doubled, desk.node.ticks) == ([], 0)  # inactive: no callbacks
    assert change(Transition.TRANSITION_ACTIVATE)
    desk.send(2)
    desk.until(lambda: desk.doubled == [4])
    desk.until(lambda: desk.node.ticks > 2)
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert change(Transition.TRANSITION_CLEANUP)
    assert desk.node.is_clean
    assert desk.node.inputs == []
    assert change(Transition.TRANSITION_CONFIGURE)  # again, from nothing
    assert change(Transition.TRANSITION_ACTIVATE)
    desk.send(3)
    desk.until(lambda: desk.doubled[-1] == 6)


def test_a_node_that_cannot_configure_stays_unconfigured(make_desk):
    desk = make_desk(file="bad")
    assert not desk.shell.start()
    desk.until(lambda: desk.text("lifecycle") == "unconfigured")
    assert desk.shell.set_parameters([Parameter("file", value="good")])[0].successful
    assert desk.shell.start()


def test_while_the_node_is_configured_only_live_parameters_change_and_all_or_none_of_several(make_desk):
    desk = make_desk()
    desk.shell.start()
    result = desk.shell.set_parameters([Parameter("factor", value=3)])[0]
    assert not result.successful
    assert result.reason.startswith("factor: fixed while the node is configured")
    desk.shell.stop()
    assert desk.shell.set_parameters([Parameter("factor", value=4)])[0].successful
    desk.shell.start()
    assert desk.node.params.factor == 4
    assert desk.shell.set_parameters([Parameter("gain", value=0.75)])[0].successful
    assert desk.node.params.gain == 0.75
    result = desk.shell.set_parameters([Parameter("gain", value=-1.0)])[0]
    assert not result.successful
    assert "gain" in result.reason
    result = desk.shell.set_parameters_atomically([Parameter("gain", value=1.0), Parameter("factor", value=5)])
    assert result.reason.startswith("factor: fixed")
    assert desk.node.params.gain == 0.75


def typed(name, kind, **value):
    return ParameterMessage(name=name, value=ParameterValue(type=kind, **value))


def test_a_parameter_of_no_type_is_refused_in_words(make_desk):
    desk, kind = make_desk(), 77
    desk.shell.start()
    odd, good = typed("gain", kind), typed("gain", 3, double_value=2.5)
    answer = desk.set(SetParameters, "set_parameters", odd, good)
    assert [result.successful for result in answer.results] == [False, True]
    assert answer.results[0].reason == f"gain: {kind} is not a valid Parameter.Type"
    result = desk.set_at_once(good, odd)
    assert (result.successful, str(kind) in result.reason) == (False, True)
    desk.send(kind)
    desk.until(lambda: desk.doubled == [2 * kind])
    assert (desk.node.params.gain, desk.executor.failures.num_failed) == (2.5, 0)


def test_the_choice_of_the_clock_is_fixed_while_the_node_is_configured(make_desk):
    desk = make_desk(autostart=False)
    clock = desk.peer.create_publisher(Clock, "/clock", 10)
    on, off = (typed("use_sim_time", 1, bool_value=value) for value in (True, False))
    clock_of = desk.shell.get_clock
    assert desk.set_at_once(on).successful
    assert clock_of().ros_time_is_active
    assert desk.set_at_once(off).successful
    desk.shell.trigger_configure()
    refused = desk.set_at_once(on)
    assert not refused.successful
    assert refused.reason.startswith("use_sim_time: fixed while the node is configured")
    assert not clock_of().ros_time_is_active
    assert clock.get_subscription_count() == 0
    assert not desk.shell.get_parameter("use_sim_time").value
    assert not desk.set_at_once(typed("gain", 3, double_value=2.0), on).successful
    assert not clock_of().ros_time_is_active
    desk.shell.trigger_cleanup()
    assert desk.set_at_once(on).successful
    assert clock_of().ros_time_is_active


def test_simulated_time_is_honoured_and_a_jump_back_is_told(make_desk):
    desk = make_desk(use_sim_time=True)
    desk.shell.start()
    desk.until(lambda: "waiting for /clock" in desk.text("lifecycle"))
    assert desk.node.ticks == 0
    clock = desk.peer.create_publisher(Clock, "/clock", 10)
    desk.until(lambda: clock.get_subscription_count() > 0)
    for tenth in range(11):
        clock.publish(Clock(clock=ns_to_time(5_000_000_000 + tenth * 100_000_000)))
        desk.until(lambda tenth=tenth: desk.node.now_ns() == 5_000_000_000 + tenth * 100_000_000)
    desk.until(lambda: desk.node.ticks > 5)
    assert desk.node.jumps == 0
    clock.publish(Clock(clock=ns_to_time(1_000_000_000)))
    desk.until(lambda: desk.node.jumps == 1)


def test_qos_can_be_overridden(make_desk):
    desk = make_desk(**{"qos_overrides./number.subscription.reliability": "best_effort"})
    desk.shell.start()
    desk.until(lambda: desk.peer.get_subscriptions_info_by_topic("/number"))
    infos = desk.peer.get_subscriptions_info_by_topic("/number")
    assert infos[0].qos_profile.reliability == qos.BEST_EFFORT
    assert qos.STATE.reliability == qos.RELIABLE  # the shared profile is as it was


def test_what_is_latched_between_configure_and_activate_is_not_lost(make_desk):
    desk = make_desk(autostart=False)
    desk.shell.start()
    desk.shell.trigger_configure()
    latched = desk.peer.create_publisher(String, "latched", qos.LATCHED)
    wanted = next(item for item in desk.node.inputs if item.topic == "latched")
    for word in ("first", "last"):
        latched.publish(String(data=word))
    desk.send(1)
    pause = time.monotonic() + 0.5
    desk.until(lambda: wanted.kept and time.monotonic() > pause)
    assert (wanted.num_received, desk.doubled) == (0, [])
    desk.shell.trigger_activate()
    assert (wanted.num_received, wanted.kept) == (1, [])  # depth 1: the last one holds
    desk.send(2)
    desk.until(lambda: desk.doubled == [4])  # what is not latched and came too early is gone


def test_a_latched_message_that_cannot_be_used_does_not_undo_the_start(make_desk):
    desk = make_desk(autostart=False)
    desk.shell.start()
    latched = desk.peer.create_publisher(String, "latched", qos.LATCHED)
    desk.shell.trigger_configure()
    latched.publish(String(data="bad"))
    desk.until(lambda: any(wanted.kept for wanted in desk.node.inputs))
    desk.shell.trigger_activate()
    desk.send(1)
    desk.until(lambda: desk.doubled == [2])
    assert desk.node.latched == ["bad"]
    assert desk.executor.failures.last_failure.startswith("subscription latched: OverflowError: bad")


@pytest.mark.slow
def test_messages_that_a_queue_could_not_hold_are_counted(make_desk):
    desk = make_desk()
    desk.shell.start()
    desk.send(1)
    desk.until(lambda: desk.doubled == [2])
    for _ in range(25):
        desk.numbers.publish(Int32(data=1))  # into a queue of ten that nobody empties
    time.sleep(0.5)
    wanted = next(item for item in desk.node.inputs if item.topic == "number")
    desk.until(lambda: wanted.num_received + wanted.num_lost == 26)
    assert wanted.num_lost > 0
    desk.until(lambda: any("input number" in text and "messages lost in the last second" in text for text in desk.said))
