"""What a node, or a part of one, has open towards ROS: topics, services, timers, clocks, log and diagnostics.

A part of a node gets these, values and callbacks; it never gets the node. Two backends open them: DDS
(`rclpy_shell.RclpyShell`) and a bag (`bags.replay.OfflineShell`).
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol

from rclpy.qos import QoSProfile

from sphere_nav.ros import qos
from sphere_nav.ros.service import Handler
from sphere_nav.ros.subscription import Subscription

COMPRESSED, COMPRESSED_DEPTH = "/compressed", "/compressedDepth"  # topics of image_transport
OK, WARN, ERROR = 0, 1, 2  # levels of diagnostic_msgs/DiagnosticStatus
Entry = tuple[int, str, dict[str, Any]]  # of the diagnostics: level, line and values
Answer = Callable[[Any, str], None]  # gets the response and an empty text, or None and why there is none


def base_topic(topic: str) -> str:
    """Return a topic of images without the ending of its transport."""
    return topic.removesuffix(COMPRESSED).removesuffix(COMPRESSED_DEPTH)


class ThrottledLog:
    """Adds `every` seconds at most once a `key` to a logger with info, warning and error.

    It remembers MAX_KEYS keys, and then begins anew: texts that never come again are forgotten.
    """

    MAX_KEYS: ClassVar[int] = 200

    def __init__(self, logger: Any, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger, self._clock = logger, clock
        self._last: dict[str, float] = {}

    def info(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what happened."""
        if self._is_due(every, key or text):
            self._logger.info(text)

    def warning(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what should be looked at."""
        if self._is_due(every, key or text):
            self._logger.warning(text)

    def error(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what does not work."""
        if self._is_due(every, key or text):
            self._logger.error(text)

    def _is_due(self, every: float, key: str) -> bool:
        if every <= 0:
            return True
        now = self._clock()
        if now - self._last.get(key, float("-inf")) < every:
            return False
        if len(self._last) >= self.MAX_KEYS:
            self._last.clear()
        self._last[key] = now
        return True


class Publisher(Protocol):
    """A topic that this node publishes."""

    def publish(self, message: Any) -> None:
        """Send a message; nothing is sent while the node is inactive."""

    def wait_for_acknowledgement(self, seconds: float) -> bool:
        """Wait until every reliable subscription has all messages; False when the time is over."""
        ...

    @property
    def num_subscriptions(self) -> int:
        """Number of subscriptions, to skip work that nobody asked for; 1 in a replay that captures the topic."""
        ...


class GoalCalls(NamedTuple):
    """What an action asks of its node.

    `check(request)` raises ValueError for a goal that is rejected; `begin(goal)` starts one, of which another may be
    under way; `cancel(goal)` asks for its end. A goal is ended by `goal.finish`, told of by `goal.publish` (see
    `sphere_nav.ros.rclpy_shell.ActionGoal`).
    """

    check: Callable[[Any], None]
    begin: Callable[[Any], None]
    cancel: Callable[[Any], None]


class Endpoints(ABC):
    """Opens them, and remembers inputs and diagnostic entries for whoever tells about the node's health."""

    log: ThrottledLog
    finish: Callable[[int], None]  # ends the process with a status, after this callback; a replay ends with its bag
    is_live: ClassVar[bool]  # messages come when they come; of a bag they wait until the node is done

    def begin(self, log: ThrottledLog) -> None:
        """Begin with nothing open."""
        self.log = log
        self.finish = lambda status: None
        self.driver_topics: dict[str, str] = {}  # of a camera's driver, by ours
        self.inputs: list[Subscription] = []
        self.reports: dict[str, Entry] = {}
        self._changes: dict[str, str] = {}  # what `tell` has logged last of each entry

    def clear(self) -> None:
        """Forget inputs and diagnostic entries: all is closed."""
        self.inputs.clear()
        self.reports.clear()

    # --- what a backend does
    @abstractmethod
    def read_parameters(self, cls: type[Any]) -> Any:
        """Return the parameters object."""

    @abstractmethod
    def now_ns(self) -> int:
        """Return the node's time in nanoseconds, simulated or recorded where that is used; 0 before /clock is heard."""

    @abstractmethod
    def steady_ns(self) -> int:
        """Return nanoseconds of a clock that nobody can set."""

    def own_ns(self) -> int:
        """Return nanoseconds of a clock that no stamp and no time server moves, by which silence is judged.

        It is steady time, or the time of /clock where that is used: then `steady_ns` tells whether /clock stands.
        """
        return self.now_ns() if self.is_time_simulated else self.steady_ns()

    @property
    @abstractmethod
    def is_time_simulated(self) -> bool:
        """Whether the node's clock is /clock; a replay has but one clock, which is none of these."""

    @abstractmethod
    def publishers_of(self, topic: str) -> list[str]:
        """Return the full names of the nodes that publish on a topic, each as often as it does; none in a replay."""

    @abstractmethod
    def listen(self, wanted: Subscription) -> None:
        """Start to deliver messages."""

    @abstractmethod
    def remove_subscription(self, wanted: Subscription) -> None:
        """Unsubscribe."""

    @abstractmethod
    def take_waiting(self, wanted: Subscription) -> None:
        """Deliver at once the messages of a topic that have come and wait for their turn.

        What was published before a message on another topic is then known when that one is answered, whichever of the
        two an executor happens to serve first.
        """

    @abstractmethod
    def add_publisher(self, topic: str, kind: type[Any], profile: QoSProfile = qos.STATE) -> Publisher:
        """Publish on a topic."""

    @abstractmethod
    def add_service(self, name: str, kind: type[Any], handler: Handler) -> None:
        """Offer a service, `~/name`; `handler(request, response)` returns the response; errors become one line."""

    @abstractmethod
    def add_client(self, name: str, kind: type[Any]) -> Callable[[Any, Answer], None]:
        """Return what asks a service of another node, `name` relative and remappable; the answer may come at once."""

    @abstractmethod
    def add_action(self, name: str, kind: type[Any], calls: GoalCalls) -> None:
        """Offer an action."""

    @abstractmethod
    def add_timer(self, seconds: float, callback: Callable[[], None], *, is_wall: bool = False) -> None:
        """Call back every so many seconds of the node's clock, or of the wall's."""

    # --- what is the same for all
    def add_subscription(
        self,
        topic: str,
        kind: type[Any],
        callback: Callable[[Any], None],
        profile: QoSProfile = qos.SENSOR,
        *,
        is_required: bool = True,
        silence: float = 2.0,
        raw: bool = False,
    ) -> Subscription:
        """Subscribe. A required topic is explained while it is absent, or silent for more than `silence` seconds.

        `silence=0` accepts any pause after the first message (latched topics). `raw`: the callback gets bytes.
        Latched messages that come before the node is active are delivered when it is.
        """
        wanted = Subscription(
            topic, kind, callback, profile, is_required=is_required, silence=silence, raw=raw, log=self.log
        )
        base = base_topic(topic)
        wanted.source = self.driver_topics.get(base, base) + topic[len(base) :]
        self.inputs.append(wanted)
        self.listen(wanted)
        return wanted

    def hear_always(
        self, topic: str, kind: type[Any], callback: Callable[[Any], None]
    ) -> tuple[Subscription, Subscription]:
        """Subscribe whatever QoS a publisher offers, also while the node is inactive; a message may come twice.

        What was latched before comes by a subscription of its own, which the diagnostics leave out.
        """
        live = self.add_subscription(topic, kind, callback, qos.SENSOR, is_required=False, silence=0.0)
        live.is_always = True
        latched = Subscription(topic, kind, callback, qos.LATCHED, is_required=False, silence=0.0, log=self.log)
        latched.is_always, latched.source = True, topic
        latched.entity_id = "latched"  # else rclpy gives it the QoS of the first
        self.listen(latched)
        return live, latched

    def speakers_of(self, topic: str) -> list[str]:
        """Return who publishes a topic that this node hears; those of one name are one where only one of them speaks.

        A node that was killed stays known for some 20 s, beside the one that was started in its place.
        """
        names = self.publishers_of(topic)
        is_of_one = any(wanted.topic == topic and wanted.is_of_one for wanted in self.inputs)
        return sorted(set(names)) if is_of_one else names

    def report(self, name: str, level: int, message: str, **values: Any) -> None:
        """Set the diagnostic entry `name`: OK, WARN or ERROR, one line, and named values."""
        self.reports[name] = (level, message, values)

    def tell(self, name: str, level: int, message: str, change: str, *, every: float = 0.0, **values: Any) -> None:
        """Set a diagnostic entry, and log it where `change` is not what it was, `every` so many seconds at most."""
        self.report(name, level, message, **values)
        if change != self._changes.get(name, ""):
            (self.log.info if level == OK else self.log.warning)(message, every=every, key=change)
        self._changes[name] = change
