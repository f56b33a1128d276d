"""A node of this package: it declares parameters, converts, delegates, converts back, publishes.

A `ManagedNode` is the same object live (rclpy and DDS beneath it, `live.py`) and in a replay (a bag beneath it,
`replay.py`); what is beneath are its `Endpoints`. A whole node:

    class Blinker(ManagedNode):
        NAME = "blinker"
        PARAMS = BlinkerParams                      # made by @sphere_nav.params.parameters
        params: BlinkerParams

        def configure(self) -> None:                # open files, allocate, wire; ValueError refuses to start
            self.lamp = Lamp(self.params.lamp)
            self.state = self.add_publisher("state", Bool, qos.STATE)
            self.add_subscription("image_raw", Image, self.on_image, qos.SENSOR)
            self.add_service("~/reset", Trigger, self.on_reset)
            self.add_timer(0.5, self.on_tick)           # seconds of the node's clock

        def on_image(self, message: Image) -> None: # ValueError: the message is refused, counted and explained
            self.state.publish(Bool(data=self.lamp.see(image_to_array(message))))

    def main() -> int:
        return run(Blinker)                         # sphere_nav.ros.run

Topic names are relative and remappable. Callbacks come one at a time, and only while the node is active.
"""

from __future__ import annotations

from typing import Any, ClassVar

from sphere_nav.params import parameters
from sphere_nav.ros.camera.drivers import topics_by_driver
from sphere_nav.ros.endpoints import ERROR, OK, WARN, Endpoints, Publisher, ThrottledLog

__all__ = ["ERROR", "OK", "WARN", "ManagedNode", "NoParams", "Publisher", "ThrottledLog"]


@parameters
class NoParams:
    """For a node without parameters."""


class ManagedNode:
    """Base of all nodes. Subclasses set NAME and PARAMS and override `configure`; the rest is optional."""

    NAME: ClassVar[str] = "node"
    PARAMS: ClassVar[type[Any]] = NoParams
    PATIENCE: ClassVar[float] = 1.7  # s from a signal to the end of the process, whatever a callback is doing
    LARGE_MESSAGES: ClassVar[bool] = False  # publishes messages above 64 KB: a larger shared-memory segment is used
    params: Any

    def __init__(self, endpoints: Endpoints) -> None:
        """`endpoints` are those of `run` (live) or of `replay` (offline); the parameters are read and checked here."""
        self.endpoints = endpoints  # what the parts of a node get
        self.log = endpoints.log
        self.add_subscription, self.remove_subscription = endpoints.add_subscription, endpoints.remove_subscription
        self.add_publisher, self.add_service = endpoints.add_publisher, endpoints.add_service
        self.add_timer, self.report = endpoints.add_timer, endpoints.report
        self.now_ns, self.steady_ns, self.own_ns = endpoints.now_ns, endpoints.steady_ns, endpoints.own_ns
        self.publishers_of = endpoints.publishers_of
        self.inputs, self.reports = endpoints.inputs, endpoints.reports
        self.params = endpoints.read_parameters(self.PARAMS)
        endpoints.driver_topics = topics_by_driver(getattr(self.params, "driver", ""))

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

    def tune(self, params: Any) -> None:
        """Go on with other values of the live parameters."""
        self.params = params

    def lack(self) -> str:
        """Return what it needs besides its inputs, and how to give it; empty where it has that."""
        return ""

    def unfinished(self) -> str:
        """Return in one line what would be left half done if the process ended now, and what to do about it."""
        return ""
