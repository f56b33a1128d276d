"""A bag beneath ManagedNodes: their very callbacks in the order of recording, without DDS, threads or wall time.

    bus = OfflineBus()
    node = bus.add(LocalizerNode, {"map": "kitchen"}, remap={"image_raw": "left/image_raw"})
    with BagReader("drive") as bag:
        for published in replay(bag, bus):
            print(published.topic, published.stamp_ns, published.message)

The clock of the nodes is the recording's; timers fire between the messages when they are due. What a node publishes
reaches the listeners of all nodes of the bus at once, in the order of publishing. So a replay is the same every time.
"""

from __future__ import annotations

import heapq
import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CompressedImage, Image

from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import Recorded
from sphere_nav.ros.bags.streams import read_streams
from sphere_nav.ros.bags.writer import BagWriter, absolute
from sphere_nav.ros.constants import MAX_AHEAD_NS
from sphere_nav.ros.endpoints import Answer, Endpoints, GoalCalls, ThrottledLog
from sphere_nav.ros.interfaces import type_name
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.service import Handler, answer_always
from sphere_nav.ros.subscription import Subscription

Node = TypeVar("Node", bound=ManagedNode)


class OfflinePublisher:
    """What a node publishes on goes to the bus."""

    def __init__(self, bus: OfflineBus, topic: str) -> None:
        self._bus, self._topic = bus, topic

    def publish(self, message: Any) -> None:
        """Hand a message to the bus."""
        self._bus.publish(self._topic, message)

    def wait_for_acknowledgement(self, seconds: float) -> bool:
        """Return at once: the bus loses nothing."""
        return True

    @property
    def num_subscriptions(self) -> int:
        """Number of listeners on the bus; one more where the topic is captured."""
        return len(self._bus.listeners.get(self._topic, ())) + self._bus.is_captured(self._topic)


class OfflineShell(Endpoints):
    """What a node of a replay talks to."""

    is_live = False
    is_time_simulated = False

    def __init__(self, bus: OfflineBus, name: str, values: Mapping[str, Any], remap: Mapping[str, str]) -> None:
        self._bus, self._values, self._remap = bus, values, remap
        self.begin(ThrottledLog(logging.getLogger(f"sphere_nav.{name}"), clock=lambda: bus.now_ns / 1e9))
        self._node_name = name
        self.services: dict[str, tuple[type[Any], Handler]] = {}
        self.actions: dict[str, GoalCalls] = {}

    def read_parameters(self, cls: type[Any]) -> Any:
        """Return the parameters object; unknown names and values out of range raise ValueError."""
        return build(cls, self._values)

    def now_ns(self) -> int:
        """Return the time of the recording."""
        return self._bus.now_ns

    steady_ns = now_ns  # there is no other

    def publishers_of(self, topic: str) -> list[str]:
        """Return none: a bag does not say who published."""
        return []

    def listen(self, wanted: Subscription) -> None:
        """Listen on the bus."""
        wanted.resolved = self._source_of(wanted)
        self._bus.listeners.setdefault(wanted.resolved, []).append(wanted)

    def add_publisher(self, topic: str, kind: type[Any], profile: QoSProfile = qos.STATE) -> OfflinePublisher:
        """Publish on the bus."""
        self._bus.profiles[self._name(topic)] = profile
        return OfflinePublisher(self._bus, self._name(topic))

    def add_service(self, name: str, kind: type[Any], handler: Handler) -> None:
        """Keep a service for `call`."""
        self.services[name.removeprefix("~/")] = (kind, answer_always(handler, name, self.log))

    def add_client(self, name: str, kind: type[Any]) -> Callable[[Any, Answer], None]:
        """Return what asks a service of another node of the bus, `node/service`, and answers at once."""
        node_name, _, service = name.strip("/").rpartition("/")

        def call(request: Any, answer: Answer) -> None:
            for node in self._bus.nodes:
                shell = node.endpoints
                if node_name == node.NAME and isinstance(shell, OfflineShell) and service in shell.services:
                    answer(shell.call(service, request), "")
                    return
            answer(None, f"/{node_name}/{service}: no such service: see that its node runs")

        return call

    def add_action(self, name: str, kind: type[Any], calls: GoalCalls) -> None:
        """Keep an action for `self.actions[name]`: check, begin and cancel."""
        self.actions[name] = calls

    def take_waiting(self, wanted: Subscription) -> None:
        """Do nothing: on the bus nothing waits."""

    def remove_subscription(self, wanted: Subscription) -> None:
        """Stop to listen."""
        self.inputs.remove(wanted)
        self._bus.listeners[wanted.resolved].remove(wanted)

    def add_timer(self, seconds: float, callback: Callable[[], None], *, is_wall: bool = False) -> None:
        """Fire on the recording's clock, which is the only one here."""
        self._bus.add_timer(seconds, callback)

    def call(self, name: str, request: Any = None) -> Any:
        """Call a service of the node as a client would, and return its response."""
        kind, handler = self.services[name]
        return handler(kind.Request() if request is None else request, kind.Response())

    def _source_of(self, wanted: Subscription) -> str:
        is_remapped = wanted.topic.lstrip("/") in self._remap
        return self._name(wanted.topic if is_remapped else wanted.source)

    def _name(self, topic: str) -> str:
        name = self._remap.get(topic.lstrip("/"), topic)
        return absolute(name.replace("~", f"/{self._node_name}", 1) if name.startswith("~/") else name)


class OfflineBus:
    """The nodes of a replay, their clock, and what they say to each other."""

    def __init__(self, captured: set[str] | None = None, start_ns: int = 0) -> None:
        """`captured`: topics that `replay` yields; None: all. `start_ns`: when nodes begin to wait, by the bag."""
        self.now_ns = start_ns
        self.listeners: dict[str, list[Subscription]] = {}
        self.profiles: dict[str, QoSProfile] = {}
        self.nodes: list[ManagedNode] = []
        self._captured = None if captured is None else {absolute(topic) for topic in captured}
        self._sent: deque[Recorded] = deque()
        self._timers: list[tuple[int, int, int, Callable[[], None]]] = []

    def add(
        self,
        node_class: type[Node],
        values: Mapping[str, Any] | None = None,
        remap: Mapping[str, str] | None = None,
    ) -> Node:
        """Make a node with parameters by dotted name and topics renamed; it is configured and active on return."""
        node = node_class(OfflineShell(self, node_class.NAME, values or {}, remap or {}))
        node.configure()
        node.activate()
        self.nodes.append(node)
        return node

    def publish(self, topic: str, message: Any) -> None:
        """Deliver a message when the present callback is done."""
        self._sent.append(Recorded(topic, self.now_ns, message))

    def is_captured(self, topic: str) -> bool:
        """Whether `replay` yields what is published on a topic."""
        return self._captured is None or topic in self._captured

    def add_timer(self, seconds: float, callback: Callable[[], None]) -> None:
        """Call back every so many seconds of the recording, from the next message on."""
        heapq.heappush(self._timers, (0, len(self._timers), round(seconds * 1e9), callback))

    def advance(self, stamp_ns: int) -> Iterator[Recorded]:
        """Let time pass up to a stamp, firing timers; yield what the nodes publish."""
        while self._timers and self._timers[0][0] <= stamp_ns:
            due, number, period, callback = heapq.heappop(self._timers)
            if due == 0:  # the first message starts the clock
                due = stamp_ns
            else:
                self.now_ns = max(due, self.now_ns)
                callback()
                yield from self.settle()
            heapq.heappush(self._timers, (due + period, number, period, callback))
        self.now_ns = max(stamp_ns, self.now_ns)

    def deliver(self, topic: str, message: Any) -> None:
        """Hand a message to every node that listens."""
        for wanted in self.listeners.get(topic, ()):
            wanted.deliver(message if not wanted.raw or isinstance(message, bytes) else serialize_message(message))

    def settle(self) -> Iterator[Recorded]:
        """Deliver what was published until no one says anything more; yield what is captured."""
        while self._sent:
            published = self._sent.popleft()
            self.deliver(published.topic, published.message)
            if self.is_captured(published.topic):
                yield published

    def close(self) -> None:
        """Bring every node down."""
        while self.nodes:
            node = self.nodes.pop()
            node.deactivate()
            node.cleanup()


def replay(
    bag: BagReader,
    bus: OfflineBus,
    *,
    progress: Callable[[int], None] = lambda step: None,
) -> Iterator[Recorded]:
    """Play a bag to the nodes of a bus and yield what they publish; `progress(1)` after every message delivered.

    Only topics that some node listens to are read; one that is required and not there raises BagError. A recorder's
    clock that was behind the stamps of a sensor is put right: nodes would refuse what is ahead of their clock.
    """
    topics = required_topics(bag, bus)
    lead_ns = max((stream.lead_ns for stream in read_streams(bag) if stream.topic in topics), default=0)
    lead_ns *= lead_ns > MAX_AHEAD_NS  # else it is no fault
    yield from bus.settle()
    for topic, stamp, data in bag.raw(topics):
        yield from bus.advance(stamp + lead_ns)
        for wanted in bus.listeners[topic]:
            kind = CompressedImage if is_compressed(bag, topic, wanted.kind) else wanted.kind
            wanted.deliver(data if wanted.raw else bag.decode(topic, data, kind))
        yield from bus.settle()
        progress(1)


def required_topics(bag: BagReader, bus: OfflineBus) -> list[str]:
    """Return the topics of the bag that the nodes listen to; BagError where a required one is not there."""
    published = set(bus.profiles)
    for topic, inputs in bus.listeners.items():
        for wanted in inputs:
            if (wanted.is_required and topic not in published) or topic in bag.topics:
                is_readable = topic not in bag.topics or is_compressed(bag, topic, wanted.kind)
                bag.require(topic, None if is_readable else wanted.kind)
    return [topic for topic in bus.listeners if topic in bag.topics]


def is_compressed(bag: BagReader, topic: str, kind: type[Any]) -> bool:
    """Whether images are wanted from a topic where the bag has compressed ones: who takes images takes both."""
    return kind is Image and bag.topics[topic].type == type_name(CompressedImage)


def record(published: Iterator[Recorded], bag: BagWriter, bus: OfflineBus) -> Iterator[Recorded]:
    """Pass on what a replay yields, and write it into a bag on the way."""
    for item in published:
        if item.topic in bus.profiles:
            bag.add_topic(item.topic, type(item.message), bus.profiles[item.topic])
        bag.write(item.topic, item.message, item.stamp_ns)
        yield item
