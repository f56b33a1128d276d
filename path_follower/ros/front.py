"""A node in front of a loop: parameters, services, files and lifecycle here, commands there.

On a vehicle the loop runs in the process that started this one (`loop_process.py`), so that nothing that comes in here
holds up a command; in a replay it is a part of the node. What goes over is checked and finished.
"""

from __future__ import annotations

import os
import signal
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, ClassVar, cast

from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.node import ManagedNode

PATIENCE, LONG_PATIENCE = 2.0, 20.0  # s for an answer of the loop, whose cycle is milliseconds; and until it is made
PRIORITY = 5  # nice value of a front that is active
LOOP = "SPHERE_NAV_LOOP"  # in the environment: descriptors of the connection to the loop, and of what tells its end


class LoopEnded(ValueError):
    """The process of the loop is gone, or ending."""


class RemoteLoop:
    """The loop in another process: each request is sent, and its answer awaited."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._number = connection, 0

    def ask(self, name: str, *values: Any) -> Any:
        """Return the answer of the loop; ValueError where it refuses, or does not answer."""
        self._number += 1
        try:
            self._connection.send((self._number, name, values))
            while self._connection.poll(LONG_PATIENCE if name == "configure" else PATIENCE):
                number, is_done, answer = self._connection.recv()
                if number == self._number:  # an older one was not awaited
                    if not is_done:
                        raise ValueError(answer)
                    return answer
        except (OSError, EOFError):
            raise LoopEnded(f"{name}: the control loop has ended") from None
        raise ValueError(f"{name}: no answer of the control loop for {PATIENCE:g} s")


class FrontNode(ManagedNode):
    """A node whose commands come from a loop; subclasses set LOOP_CLASS and use `self.loop.ask`."""

    LOOP_CLASS: ClassVar[type[Any]]

    def __init__(self, shell: Endpoints) -> None:
        """Connect with the loop that started this process, if one did."""
        super().__init__(shell)
        self.remote = connected() if shell.is_live else None

    def configure(self) -> None:
        """Begin the loop, here or in the process of its own."""
        if self.remote is None:
            self.loop: Any = self.LOOP_CLASS(self.endpoints, self.params)
            return
        shell = cast("Any", self.endpoints)
        overrides = {key: value.value for key, value in shell._parameter_overrides.items() if key.startswith("qos_")}
        self.loop = self.remote
        self.remote.ask(
            "configure",
            {
                "name": f"{shell.get_name()}_loop",
                "namespace": shell.get_namespace(),
                "health_name": shell.health_name,
                "topics": {topic: shell.resolve_topic_name(topic) for topic in self.LOOP_CLASS.TOPICS},
                "overrides": overrides | {"use_sim_time": shell.get_parameter("use_sim_time").value},
                "params": self.params,
            },
        )

    def activate(self) -> None:
        """Let commands go out; from now on the loop goes first."""
        if self.remote is not None:
            os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
            self.remote.ask("activate")

    def deactivate(self) -> None:
        """Leave the vehicle with a zero command."""
        self._tell("stand" if self.remote is None else "deactivate")

    def cleanup(self) -> None:
        """Close the loop's topics."""
        if self.remote is not None:
            self._tell("cleanup")

    def clock_jumped(self) -> None:
        """Hand on that the clock went backwards; a loop of its own process sees that itself."""
        if self.remote is None:
            self.loop.ask("clock_jumped")

    def _tell(self, name: str) -> None:
        with suppress(LoopEnded):  # with a zero command
            self.loop.ask(name)


def connected() -> RemoteLoop | None:
    """Return the loop that started this process, if one did, and end with it."""
    if LOOP not in os.environ:
        return None
    connection, life = map(int, os.environ.pop(LOOP).split())
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()
    return RemoteLoop(Connection(connection))


def _end_with(life: int) -> None:
    while os.read(life, 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
