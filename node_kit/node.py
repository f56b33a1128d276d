"""A node of this package: it declares parameters, converts, delegates, converts back, publishes.

A `ManagedNode` is the same object live (rclpy and DDS beneath it, `live.py`) and in a replay (a bag beneath it,
`replay.py`); what is beneath is its `Shell`. A whole node:

    class Blinker(ManagedNode):
        NAME = "blinker"
        PARAMS = BlinkerParams                      # made by @typed_params.parameters
        params: BlinkerParams

        def configure(self) -> None:                # open files, allocate, wire; ValueError refuses to start
            self.lamp = Lamp(self.params.lamp)
            self.state = self.add_publisher("state", Bool, qos.STATE)
            self.add_subscription("image_raw", Image, self.on_image, qos.SENSOR)
            self.add_service("reset", Trigger, self.on_reset)
            self.add_timer(0.5, self.on_tick)           # seconds of the node's clock

        def on_image(self, message: Image) -> None: # ValueError: the message is refused, counted and explained
            self.state.publish(Bool(data=self.lamp.see(image_to_array(message))))

    def main() -> int:
        return run(Blinker)                         # node_kit.run

Topic names are relative and remappable. Callbacks come one at a time, and only while the node is active.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol

from rclpy.qos import QoSProfile

from node_kit import qos
from node_kit.subscription import Subscription
from typed_params import parameters

OK, WARN, ERROR, STALE = 0, 1, 2, 3  # levels of diagnostic_msgs/DiagnosticStatus


@parameters
class NoParams:
    """For a node without parameters."""


class Log(Protocol):
    """Where a node speaks. `every` seconds at most once a `key` (the text itself without one)."""

    def info(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what happened."""

    def warning(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what should be looked at."""

    def error(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what does not work."""


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


class Shell(Protocol):
    """What is beneath a node: DDS (`live.LiveShell`) or a bag (`replay.OfflineShell`)."""

    log: Log

    def read_parameters(self, cls: type[Any]) -> Any:
        """Return the parameters object."""

    def now_ns(self) -> int:
        """Return the time of the node's clock; simulated or recorded time where that is used."""

    def steady_ns(self) -> int:
        """Return the time of a clock that nobody can set."""

    def own_ns(self) -> int:
        """Return the time by which silence is judged: steady, or that of /clock where time is simulated."""

    def publishers_of(self, topic: str) -> list[str]:
        """Return the full names of the nodes that publish on a topic, as far as known."""

    def add_subscription(self, wanted: Subscription) -> None:
        """Start to deliver messages."""

    def add_publisher(self, topic: str, kind: type[Any], profile: QoSProfile) -> Publisher:
        """Open a topic for publishing."""

    def add_service(self, name: str, kind: type[Any], handler: Callable[[Any, Any], Any]) -> None:
        """Offer a service."""

    def add_timer(self, seconds: float, callback: Callable[[], None], *, is_wall: bool) -> None:
        """Call back regularly."""

    def remove_subscription(self, wanted: Subscription) -> None:
        """Stop to deliver messages."""

    def finish(self, status: int) -> None:
        """End the process, or the replay, in order."""


class ManagedNode:
    """Base of all nodes. Subclasses set NAME and PARAMS and override `configure`; the rest is optional."""

    NAME: ClassVar[str] = "node"
    PARAMS: ClassVar[type[Any]] = NoParams
    LARGE_MESSAGES: ClassVar[bool] = False  # publishes messages above 64 KB: a larger shared-memory segment is used
    params: Any

    def __init__(self, shell: Shell) -> None:
        """`shell` is given by `run` (live) or by `replay` (offline); the parameters are read and checked here."""
        self.shell = shell
        self.log = shell.log
        self.inputs: list[Subscription] = []
        self.reports: dict[str, tuple[int, str, dict[str, Any]]] = {}
        self.params = shell.read_parameters(self.PARAMS)

    # --- what a subclass overrides
    def configure(self) -> None:
        """Open files and topics, allocate, warm up kernels. ValueError or OSError refuses to start."""

    def activate(self) -> None:
        """Begin to work: callbacks come from now on."""

    def deactivate(self) -> None:
        """Pause: no callbacks, no messages go out."""

    def cleanup(self) -> None:
        """Close what `configure` opened; also called before the process ends."""

    def clock_jumped(self) -> None:
        """Forget everything with a stamp: the clock went backwards, as when a bag starts again."""

    # --- what a subclass calls
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
        """
        wanted = Subscription(
            topic, kind, callback, profile, is_required=is_required, silence=silence, raw=raw, log=self.log
        )
        self.inputs.append(wanted)
        self.shell.add_subscription(wanted)
        return wanted

    def add_publisher(self, topic: str, kind: type[Any], profile: QoSProfile = qos.STATE) -> Publisher:
        """Publish on a topic."""
        return self.shell.add_publisher(topic, kind, profile)

    def add_service(self, name: str, kind: type[Any], handler: Callable[[Any, Any], Any]) -> None:
        """Offer a service; `handler(request, response)` returns the response."""
        self.shell.add_service(name, kind, handler)

    def add_timer(self, seconds: float, callback: Callable[[], None], *, is_wall: bool = False) -> None:
        """Call back every so many seconds of the node's clock, or of the wall's."""
        self.shell.add_timer(seconds, callback, is_wall=is_wall)

    def remove_subscription(self, wanted: Subscription) -> None:
        """Unsubscribe."""
        self.inputs.remove(wanted)
        self.shell.remove_subscription(wanted)

    def finish(self, status: int = 0) -> None:
        """Ask for the end of the process: the work is done (0), or cannot be done (1)."""
        self.shell.finish(status)

    def now_ns(self) -> int:
        """Return the node's time in nanoseconds; 0 while a simulated clock has not been heard."""
        return self.shell.now_ns()

    def steady_ns(self) -> int:
        """Return nanoseconds of a clock that nobody can set."""
        return self.shell.steady_ns()

    def own_ns(self) -> int:
        """Return nanoseconds of a clock that no stamp and no time server moves, by which silence is judged.

        It is steady time, or the time of /clock where that is used: then `steady_ns` tells whether /clock stands.
        """
        return self.shell.own_ns()

    def publishers_of(self, topic: str) -> list[str]:
        """Return the full names of the nodes that publish on a topic, each as often as it does; none in a replay."""
        return self.shell.publishers_of(topic)

    def report(self, name: str, level: int, message: str, **values: Any) -> None:
        """Set the diagnostic entry `name`: OK, WARN, ERROR or STALE, one line, and named values."""
        self.reports[name] = (level, message, values)
