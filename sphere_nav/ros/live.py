"""rclpy beneath a ManagedNode: lifecycle, diagnostics, and in words what the node waits for."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from copy import copy
from typing import Any, cast

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from sphere_nav.params import leaves, param
from sphere_nav.params import parameters as params_class
from sphere_nav.ros import parameters, qos
from sphere_nav.ros.endpoints import ERROR, OK, WARN
from sphere_nav.ros.interfaces import type_name
from sphere_nav.ros.node import Log, ManagedNode, ThrottledLog
from sphere_nav.ros.service import one_line
from sphere_nav.ros.subscription import Subscription

HEALTH_PERIOD = 1.0  # s
EXPLAIN_PERIOD = 10.0  # s between two equal explanations in the log
MAX_REFUSED = 4  # messages in a row that are refused without an alarm


@params_class
class ShellParams:
    """What every live node has besides its own parameters."""

    autostart: bool = param(True, "configure and activate at once instead of waiting for a lifecycle manager")


class LivePublisher:
    """A publisher that is silent while its node is inactive."""

    def __init__(self, shell: LiveShell, publisher: Publisher) -> None:
        self._shell, self._publisher = shell, publisher

    def publish(self, message: Any) -> None:
        """Send a message, or bytes, unless the node is inactive."""
        if self._shell.is_active:
            self._publisher.publish(message)

    @property
    def num_subscriptions(self) -> int:
        """Number of matched subscriptions."""
        return self._publisher.get_subscription_count()

    def wait_for_acknowledgement(self, seconds: float) -> bool:
        """Wait until every reliable subscription has all messages; False when the time is over."""
        return self._publisher.wait_for_all_acked(Duration(seconds=seconds))


class LiveShell(LifecycleNode):
    """A lifecycle node that carries out what its ManagedNode asks for."""

    is_live = True

    def __init__(self, node_class: type[ManagedNode], **options: Any) -> None:
        super().__init__(node_class.NAME, enable_logger_service=True, **options)
        self.log: Log = ThrottledLog(self.get_logger())
        self.is_active = False
        self.is_configured = False
        self.on_finish: Callable[[int], None] = lambda status: None
        self._entities: list[Callable[[], object]] = []
        self._own_publishers: list[Publisher] = []
        parameters.declare(self, ShellParams, lambda: "decided when the process starts")
        parameters.declare(self, node_class.PARAMS, self._why_fixed)
        self.add_post_set_parameters_callback(self._tune)
        for line in parameters.unknown_overrides(self):
            self.log.warning(line)
        self.node = node_class(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", qos.STATE)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(HEALTH_PERIOD, self._tell_health, clock=self._steady)
        backwards = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False)
        self._jump = self.get_clock().create_jump_callback(backwards, post_callback=self._on_jump)

    def start(self) -> bool:
        """Configure and activate if `autostart` says so; whether the node is where it should be."""
        if not self.get_parameter("autostart").value:
            return True
        done = TransitionCallbackReturn.SUCCESS
        return self.trigger_configure() == done and self.trigger_activate() == done

    def stop(self) -> None:
        """Bring the node down in order, whatever its state; used before the process ends."""
        if self.is_active:
            self.trigger_deactivate()
        if self.is_configured:
            self.trigger_cleanup()

    # --- transitions
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured to inactive; a ValueError or OSError of the node is one line in the log."""
        try:
            self.node.params = self.read_parameters(self.node.PARAMS)
            self.node.configure()
        except (ValueError, OSError) as error:
            self.log.error(f"cannot start: {one_line(error)}")
            self._release()
            return TransitionCallbackReturn.FAILURE
        except Exception:
            return self._failed()
        self.is_configured = True
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive to active; what was latched meanwhile is delivered."""
        self.is_active = True
        result = self._attempt(self.node.activate)
        for wanted in self.node.inputs if result == TransitionCallbackReturn.SUCCESS else ():
            wanted.deliver_kept()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active to inactive."""
        result = self._attempt(self.node.deactivate)
        self.is_active = False
        return result

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive to unconfigured."""
        self.is_configured = False
        result = self._attempt(self.node.cleanup)
        self._release()
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Whatever to finalized."""
        if self.is_active:
            self.on_deactivate(state)
        return self.on_cleanup(state) if self.is_configured else TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After a failed transition: back to unconfigured."""
        self.is_active = self.is_configured = False
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def _attempt(self, step: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            step()
        except Exception:
            return self._failed()
        return TransitionCallbackReturn.SUCCESS

    def _failed(self) -> TransitionCallbackReturn:
        self.log.error(traceback.format_exc().rstrip())  # rclpy swallows it
        return TransitionCallbackReturn.ERROR

    # --- what the node asks for
    def read_parameters(self, cls: type[Any]) -> Any:
        """Return the parameters object with the present values."""
        return parameters.read(self, cls)

    def now_ns(self) -> int:
        """Return the time of the ROS clock in nanoseconds."""
        return self.get_clock().now().nanoseconds

    def steady_ns(self) -> int:
        """Return the time of the monotonic clock in nanoseconds."""
        return time.monotonic_ns()

    def own_ns(self) -> int:
        """Return monotonic time, or the time of /clock where `use_sim_time` is set."""
        return self.now_ns() if self.is_time_simulated else self.steady_ns()

    @property
    def is_time_simulated(self) -> bool:
        """Whether the node's clock is /clock."""
        return bool(self.get_parameter("use_sim_time").value)

    def publishers_of(self, topic: str) -> list[str]:
        """Return the full names of the nodes that publish on a topic."""
        infos = self.get_publishers_info_by_topic(self.resolve_topic_name(topic))
        return sorted(f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in infos)

    def add_subscription(self, wanted: Subscription) -> None:
        """Subscribe; while the node is inactive messages are dropped, latched ones kept until it is active.

        rclpy's own warnings of what DDS does not connect are off: they cost the executor more than all the rest
        together, two waitables a topic in every wait. `_tell_health` says the same once a second.
        """

        def deliver(message: Any, info: dict[str, Any]) -> None:
            if self.is_active:
                wanted.count(info["publication_sequence_number"], self.count_publishers(wanted.handle.topic_name))
                wanted.deliver(message)
            else:
                wanted.keep(message)

        wanted.profile = copy(wanted.profile)  # rclpy writes overrides (qos_overrides.*) into it
        options = QoSOverridingOptions.with_default_policies()
        wanted.handle = self.create_subscription(
            wanted.kind,
            self._source_of(wanted),
            deliver,  # type: ignore[arg-type]  # rclpy passes the message's info to callbacks with two parameters
            wanted.profile,
            raw=wanted.raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=options,
        )
        self._entities.append(lambda: self.destroy_subscription(wanted.handle))

    def take_waiting(self, wanted: Subscription) -> None:
        """Deliver at once the messages of a topic that have come and wait for their turn."""
        subscription = wanted.handle
        while True:
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                return
            subscription.callback(*taken)

    def _source_of(self, wanted: Subscription) -> str:
        """Return the topic to subscribe to: a driver's, unless the user has remapped ours."""
        is_remapped = self.resolve_topic_name(wanted.topic) != self.resolve_topic_name(wanted.topic, only_expand=True)
        return wanted.topic if is_remapped or not wanted.source else wanted.source

    def add_publisher(self, topic: str, kind: type[Any], profile: QoSProfile) -> LivePublisher:
        """Make a publisher that follows the lifecycle."""
        options = QoSOverridingOptions.with_default_policies()
        publisher = self.create_publisher(
            kind,
            topic,
            copy(profile),
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=options,
        )
        self._own_publishers.append(publisher)
        self._entities.append(lambda: self.destroy_publisher(publisher))
        return LivePublisher(self, publisher)

    def add_service(self, name: str, kind: type[Any], handler: Callable[[Any, Any], Any]) -> None:
        """Make a service, `~/name` below the node's own name; it answers while the node is inactive, too."""
        service = self.create_service(kind, name, handler)
        self._entities.append(lambda: self.destroy_service(service))

    def remove_subscription(self, wanted: Subscription) -> None:
        """Unsubscribe."""
        self.destroy_subscription(wanted.handle)

    def finish(self, status: int) -> None:
        """End the process after this callback."""
        self.on_finish(status)

    def add_timer(self, seconds: float, callback: Callable[[], None], *, is_wall: bool) -> None:
        """Make a timer on the node's clock, or the steady one; it is silent while the node is inactive."""

        def tick() -> None:
            if self.is_active:
                callback()

        timer = self.create_timer(seconds, tick, clock=self._steady if is_wall else self.get_clock())
        self._entities.append(lambda: self.destroy_timer(timer))

    def _tune(self, changes: list[Parameter]) -> None:
        """Hand on live parameters that were changed; the others are read when the node is configured."""
        live = {leaf.name for leaf in leaves(self.node.PARAMS) if leaf.is_live} if self.is_configured else set()
        if any(change.name in live for change in changes):
            self.node.tune(self.read_parameters(self.node.PARAMS))

    # --- health
    def _why_fixed(self) -> str:
        return "fixed while the node is configured; clean the node up first, or set it at start" * self.is_configured

    def _release(self) -> None:
        while self._entities:
            self._entities.pop()()
        self._own_publishers.clear()
        self.node.endpoints.clear()

    def _on_jump(self, jump: object) -> None:
        if self.is_configured:
            self.log.warning("the clock went backwards: everything with a stamp is forgotten")
            self.node.clock_jumped()

    def _tell_health(self) -> None:
        for line in unserved(self, self._own_publishers):
            self.log.warning(line, every=EXPLAIN_PERIOD)
        statuses = [self._life(), *self._lacks(), *self._reported()]
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _life(self) -> DiagnosticStatus:
        label = self._state_machine.current_state[1]
        uses_sim_time = self.get_parameter("use_sim_time").value
        if uses_sim_time and self.now_ns() == 0:
            text = "waiting for /clock (use_sim_time is true): no time yet"
            self.log.warning(text, every=EXPLAIN_PERIOD)
            return self._status("lifecycle", WARN, text, {"state": label})
        return self._status("lifecycle", OK if self.is_active else WARN, label, {"state": label})

    def _lacks(self) -> list[DiagnosticStatus]:
        inputs = self.node.inputs if self.is_active else ()
        return [self._status(f"input {wanted.topic}", *examine_input(self, wanted)) for wanted in inputs]

    def _reported(self) -> list[DiagnosticStatus]:
        return [self._status(name, *entry) for name, entry in self.node.reports.items()]

    def _status(self, name: str, level: int, message: str, values: dict[str, Any]) -> DiagnosticStatus:
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        name = f"{self.get_fully_qualified_name().lstrip('/')}: {name}"
        return DiagnosticStatus(level=bytes([level]), name=name, message=message, values=pairs)


def examine_input(shell: Any, wanted: Subscription) -> tuple[int, str, dict[str, Any]]:
    """Return level, line and counts of one input; what is missing is logged, too. `shell`: a LiveShell."""
    topic, level, text = wanted.handle.topic_name, OK, "receiving"
    is_present = wanted.num_received > 0 and not wanted.is_missing
    publishers = () if is_present else shell.get_publishers_info_by_topic(topic)
    if wanted.is_missing or wanted.incompatible(publishers):
        level, text = WARN, wanted.explain(topic, publishers)
        shell.log.warning(text, every=EXPLAIN_PERIOD, key=f"waiting {topic}")
    elif wanted.num_refused_in_row > (MAX_REFUSED if wanted.num_refused < wanted.num_received else 0):
        level, text = ERROR, f"last {wanted.num_refused_in_row} messages refused: {wanted.last_refusal}"
    elif wanted.num_lost_lately:
        level, text = WARN, f"{wanted.num_lost_lately} messages lost in the last second"
    elif not wanted.num_received:
        text = "optional, nothing received"
    wanted.num_lost_lately = 0
    return level, text, {"received": wanted.num_received, "refused": wanted.num_refused, "lost": wanted.num_lost}


def unserved(node: Node, publishers: Iterable[Publisher]) -> Iterator[str]:
    """Yield one line for each subscription that one of our publishers cannot serve."""
    for publisher in publishers:
        topic = publisher.topic_name
        if node.count_subscribers(topic) == publisher.get_subscription_count():
            continue  # all are connected
        for info in node.get_subscriptions_info_by_topic(topic):
            reason = _why_not(type_name(cast("type[Any]", publisher.msg_type)), publisher.qos_profile, info)
            if reason:
                yield f"{topic}: {info.node_namespace.rstrip('/')}/{info.node_name} gets nothing: {reason}"


def _why_not(kind: str, offered: QoSProfile, info: Any) -> str:
    if info.topic_type != kind:
        return f"it asks for {info.topic_type}, sent is {kind}"
    return qos.mismatch(offered, info.qos_profile)
