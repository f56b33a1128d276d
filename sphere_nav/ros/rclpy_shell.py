"""rclpy beneath what a node asks for: topics, services, actions, timers, clocks and diagnostics of any rclpy node."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from copy import copy
from functools import partial
from math import inf
from typing import Any
from weakref import WeakValueDictionary

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionServer
from rclpy.action.server import CancelResponse, GoalResponse, ServerGoalHandle
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from sphere_nav.params import build, leaves
from sphere_nav.ros import qos
from sphere_nav.ros.constants import HEALTH_PERIOD, LOG_PERIOD_S, MAX_REFUSED
from sphere_nav.ros.conversions.headers import MAX_STAMP_NS, ns_to_time, plain_frames
from sphere_nav.ros.endpoints import ERROR, OK, WARN, Answer, Endpoints, Entry, GoalCalls, ThrottledLog
from sphere_nav.ros.executor import CallbackFailures
from sphere_nav.ros.service import Handler, answer_always, one_line
from sphere_nav.ros.shared_files import software
from sphere_nav.ros.subscription import Subscription, full_name


class LivePublisher:
    """A publisher that is silent while its node is inactive."""

    def __init__(self, shell: RclpyShell, publisher: Publisher) -> None:
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


# --- actions
# Every callback is guarded, an answer always comes, and nothing waits in a loop. rclpy runs a goal as a coroutine; one
# that awaits something is resumed at every turn of the executor, a core at full load. Here a goal is accepted, told to
# the node, and ended by the node when it is done. Where the node raises on a request, the goal is rejected; where it
# raises on an accepted one, the goal is aborted.
class ActionGoal:
    """A goal that was accepted: feedback while it lasts, one end."""

    def __init__(self, handle: ServerGoalHandle) -> None:
        self._handle, self._is_over = handle, False
        self.request: Any = plain_frames(handle.request)

    def publish(self, feedback: Any) -> None:
        """Tell the client how it goes."""
        if not self._is_over:
            self._handle.publish_feedback(feedback)

    def finish(self, result: Any, *, success: bool) -> None:
        """End it: succeeded, canceled where the client wanted that, else aborted."""
        if self._is_over:
            return
        self._is_over = True

        def end(handle: ServerGoalHandle) -> Any:
            if success:
                handle.succeed()
            elif handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return result

        self._handle.execute(end)


def serve_action(shell: RclpyShell, kind: type[Any], name: str, calls: GoalCalls) -> ActionServer:
    """Return an action server whose goals are ended by `ActionGoal.finish`; what its callbacks raise is counted."""
    goals: WeakValueDictionary[bytes, ActionGoal] = WeakValueDictionary()  # the node keeps those under way

    def attempt(where: str, call: Callable[[], None]) -> Exception | None:
        try:
            call()
        except ValueError as error:
            shell.log.warning(f"{name}: {where}: {one_line(error)}", every=LOG_PERIOD_S)
            return error
        except Exception as error:
            shell.failures.add(error, f"{name}: {where}")
            return error
        return None

    def accept(request: Any) -> GoalResponse:
        error = attempt("goal rejected", lambda: calls.check(plain_frames(request)))
        return GoalResponse.ACCEPT if error is None else GoalResponse.REJECT

    def begin(handle: ServerGoalHandle) -> None:
        goal = goals[bytes(handle.goal_id.uuid)] = ActionGoal(handle)
        error = attempt("goal aborted", lambda: calls.begin(goal))
        if error is not None:
            result = kind.Result()
            if hasattr(result, "reason"):
                result.reason = one_line(error)
            goal.finish(result, success=False)

    def cancel(handle: ServerGoalHandle) -> CancelResponse:
        attempt("cancel", lambda: calls.cancel(goals[bytes(handle.goal_id.uuid)]))
        return CancelResponse.ACCEPT

    return ActionServer(
        shell, kind, name, begin, goal_callback=accept, handle_accepted_callback=begin, cancel_callback=cancel
    )


# --- the shell
class RclpyShell(Endpoints, Node):
    """Opens and closes what a node asks for, and tells once a second how it is; base of the shells of processes."""

    is_live = True
    callbacks_name = "callbacks"  # of the entry that counts what failed

    def __init__(self, name: str, failures: CallbackFailures | None = None, **options: Any) -> None:
        """`failures`: of a process with more than this node; `options` as of rclpy's Node."""
        super().__init__(name, **options)
        self.begin(ThrottledLog(self.get_logger()))
        self.health_name = self.get_fully_qualified_name().lstrip("/")  # in front of the entries in /diagnostics
        self.failures = failures or CallbackFailures(self.log)
        self.is_active = False
        self._entities = ExitStack()  # destroyed when the node is cleaned up
        self._was_active = False  # at the last look
        self._own_publishers: list[Publisher] = []
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", qos.STATE)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(HEALTH_PERIOD, self._tell_health, clock=self._steady)
        backwards = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False)
        self._jump = self.get_clock().create_jump_callback(backwards, post_callback=self._on_jump)

    def read_parameters(self, cls: type[Any]) -> Any:
        """Return the parameters object with the present values."""
        return build(cls, {leaf.name: self.get_parameter(leaf.name).value for leaf in leaves(cls)})

    def clock_jumped(self) -> None:
        """Forget everything with a stamp: the clock went backwards."""
        raise NotImplementedError

    def _on_jump(self, jump: object) -> None:
        self.log.warning("the clock went backwards: everything with a stamp is forgotten", every=LOG_PERIOD_S)
        self.clock_jumped()

    def now_ns(self) -> int:
        """Return the time of the ROS clock in nanoseconds, at most what a stamp holds."""
        return min(self.get_clock().now().nanoseconds, MAX_STAMP_NS)

    def steady_ns(self) -> int:
        """Return the time of the monotonic clock in nanoseconds."""
        return time.monotonic_ns()

    @property
    def is_time_simulated(self) -> bool:
        """Whether the node's clock is /clock."""
        return bool(self.get_parameter("use_sim_time").value)

    def publishers_of(self, topic: str) -> list[str]:
        """Return the full names of the nodes that publish on a topic."""
        infos = self.get_publishers_info_by_topic(self.resolve_topic_name(topic))
        return sorted(map(full_name, infos))

    def listen(self, wanted: Subscription) -> None:
        """Subscribe; while the node is inactive messages are dropped, latched ones kept until it is active.

        rclpy's own warnings of what DDS does not connect are off: they cost the executor more than all the rest
        together, two waitables a topic in every wait. `_tell_health` says the same once a second.
        """

        def deliver(message: Any, info: dict[str, Any]) -> None:
            if self.is_active or wanted.is_always:
                wanted.count(info["publication_sequence_number"], self.count_publishers(wanted.handle.topic_name))
                wanted.deliver(message)
            else:
                wanted.keep(message)

        wanted.profile = copy(wanted.profile)  # rclpy writes overrides (qos_overrides.*) into it
        options = QoSOverridingOptions.with_default_policies(entity_id=wanted.entity_id or None)
        wanted.handle = self.create_subscription(
            wanted.kind,
            self._source_of(wanted),
            deliver,  # type: ignore[arg-type]  # rclpy passes the message's info to callbacks with two parameters
            wanted.profile,
            raw=wanted.raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=options,
        )
        wanted.resolved = wanted.handle.topic_name
        self._entities.callback(self.destroy_subscription, wanted.handle)

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
        return wanted.topic if is_remapped else wanted.source

    def add_publisher(self, topic: str, kind: type[Any], profile: QoSProfile = qos.STATE) -> LivePublisher:
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
        self._entities.callback(self.destroy_publisher, publisher)
        return LivePublisher(self, publisher)

    def add_service(self, name: str, kind: type[Any], handler: Handler) -> None:
        """Make a service, `~/name` below the node's own name; it answers while the node is inactive, too."""
        service = self.create_service(kind, name, answer_always(handler, name, self.log))
        self._entities.callback(self.destroy_service, service)

    def add_client(self, name: str, kind: type[Any]) -> Callable[[Any, Answer], None]:
        """Make a client of a service, which answers at once where nobody offers that, else by the executor."""
        client = self.create_client(kind, name)
        self._entities.callback(self.destroy_client, client)

        def call(request: Any, answer: Answer) -> None:
            if client.service_is_ready():
                client.call_async(request).add_done_callback(lambda done: answer(done.result(), ""))
            else:
                answer(None, f"{client.service_name}: no such service: see that its node runs")

        return call

    def add_action(self, name: str, kind: type[Any], calls: GoalCalls) -> None:
        """Make an action server."""
        self._entities.callback(serve_action(self, kind, name, calls).destroy)

    def remove_subscription(self, wanted: Subscription) -> None:
        """Unsubscribe."""
        self.inputs.remove(wanted)
        self.destroy_subscription(wanted.handle)

    def add_timer(self, seconds: float, callback: Callable[[], None], *, is_wall: bool = False) -> None:
        """Make a timer on the node's clock, or the steady one; it is silent while the node is inactive."""

        def tick() -> None:
            if self.is_active:
                callback()

        timer = self.create_timer(seconds, tick, clock=self._steady if is_wall else self.get_clock())
        self._entities.callback(self.destroy_timer, timer)

    def _release(self) -> None:
        self._entities.close()
        self._own_publishers.clear()
        self.clear()

    def deliver_kept(self) -> None:
        """Hand on what was latched before the node was active."""
        for wanted in self.inputs:
            while wanted.kept:
                self.failures.guard(partial(wanted.deliver, wanted.kept.pop(0)), f"subscription {wanted.topic}")

    # --- health
    def _tell_health(self) -> None:
        self._tell_ready()
        inputs = self.inputs if self.is_active else ()
        entries = [*self._life(), (self.callbacks_name, self.failures.examine())]
        entries += [(f"input {wanted.topic}", examine_input(self, wanted)) for wanted in inputs]
        entries += self.reports.items()
        array = DiagnosticArray()
        array.header.stamp = ns_to_time(self.now_ns())
        for name, (level, message, values) in entries:
            pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
            name = f"{self.health_name}: {name}"
            array.status.append(DiagnosticStatus(level=bytes([level]), name=name, message=message, values=pairs))
        self._diagnostics.publish(array)

    def _tell_ready(self) -> None:
        """Say once what the node works with, and once more when all has come, after a second in which it may come."""
        was_active, self._was_active = self._was_active, self.is_active
        if not was_active or not self.is_active:
            return
        heard = {
            wanted.resolved: wanted.num_received for wanted in self.inputs if wanted.is_required or wanted.num_received
        }
        lacks = self._lack() or ", ".join(topic for topic, count in heard.items() if not count)
        reads, sends = ", ".join(heard), ", ".join(publisher.topic_name for publisher in self._own_publishers)
        what = "".join(f"; {one}" for one in (self._subject(), reads and f"reads {reads}", f"sends {sends}") if one)
        word = f"waits for {lacks}" if lacks else "ready"
        self.log.info(f"{word}: {software()}{what}", every=inf, key=word)

    def _subject(self) -> str:
        return ""

    def _lack(self) -> str:
        return ""

    def _life(self) -> Iterable[tuple[str, Entry]]:
        return ()


def examine_input(shell: Any, wanted: Subscription) -> Entry:
    """Return level, line and counts of one input; what is missing is logged, too. `shell`: a LiveShell."""
    topic, level, text = wanted.handle.topic_name, OK, "receiving"
    is_present = wanted.num_received > 0 and not wanted.is_missing
    publishers = () if is_present else shell.get_publishers_info_by_topic(topic)
    if wanted.is_missing or wanted.incompatible(publishers):
        level, text = WARN, wanted.explain(topic, publishers)
        shell.log.warning(text, every=LOG_PERIOD_S, key=f"waiting {topic}")
    elif wanted.num_refused_in_row > (MAX_REFUSED if wanted.num_refused < wanted.num_received else 0):
        level, text = ERROR, f"last {wanted.num_refused_in_row} messages refused: {wanted.last_refusal}"
    elif wanted.num_lost_lately:
        level, text = WARN, f"{wanted.num_lost_lately} messages lost in the last second"
    elif not wanted.num_received:
        text = "optional, nothing received"
    wanted.num_lost_lately = 0
    return level, text, {"received": wanted.num_received, "refused": wanted.num_refused, "lost": wanted.num_lost}
