"""A link that watches the drives of the demo: how far the car is, what the others say; it also gives the start."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Self

import numpy as np
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from tqdm import tqdm

from sphere_nav.ros import qos
from sphere_nav.ros.conversions import stamp_ns
from sphere_nav_tools.cli.constants import LOOK, SILENCE, STALL
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.processes import Processes

SERVICES = ("path_follower/start", "cycab_sim/resume", "dense_localizer/reset")


class DriveFailed(RuntimeError):
    """A drive that did not get where it should; the message says what happened."""


class DriveMonitor:
    """Hears the truth and the states; `wait` lasts until something holds."""

    def __init__(self, processes: Processes, domain_id: int) -> None:
        self.processes, self.link = processes, Link(domain_id=domain_id)
        self.travelled, self.now_ns = 0.0, 0
        self.position: np.ndarray | None = None
        node = self.link.node
        node.create_subscription(Odometry, "ground_truth/odometry", self._on_truth, qos.SENSOR)
        for name in ("taught", "paused"):
            node.create_subscription(Bool, name, partial(self.link.seen.hear, name), qos.LATCHED)
        self.link.clients |= {name: node.create_client(Trigger, name) for name in SERVICES}

    def wait(self, what: str, holds: Callable[[], bool], is_moving: bool, bar: tqdm[Any] | None = None) -> None:
        """Spin until `holds`; DriveFailed where the car should move and stands, by simulated time, or all is silent."""
        alive, last, moved_ns, heard_ns = time.monotonic(), self.travelled, self.now_ns, self.now_ns
        while not holds():
            time.sleep(LOOK)
            self.processes.check()
            if is_moving and self.now_ns > heard_ns:
                alive, heard_ns = time.monotonic(), self.now_ns
            if self.travelled > last + 0.05 or not moved_ns:
                last, moved_ns = self.travelled, self.now_ns
            if bar is not None:
                bar.update(max(0.0, min(self.travelled, bar.total) - bar.n))
            if is_moving and self.now_ns - moved_ns > STALL * 1e9:
                raise DriveFailed(f"{what}: the car stands for {STALL:.0f} s; {self.describe()}")
            if time.monotonic() - alive > SILENCE:
                raise DriveFailed(f"{what}: nothing for {SILENCE:.0f} s; {self.describe()}")

    def wait_for(self, name: str) -> None:
        """Wait until a service is there."""
        self.wait(name, self.link.clients[name].service_is_ready, is_moving=False)

    def call(self, name: str) -> None:
        """Call a service; DriveFailed says why it was refused."""
        self.wait_for(name)
        if refusal := self.link.call(name, Trigger.Request(), SILENCE):
            raise DriveFailed(f"{name} refused: {refusal}; {self.describe()}")

    def has_told(self, name: str) -> bool:
        """Whether the simulator says that it is so: `taught`, `paused`."""
        told, _ = self.link.seen.told(name)
        return told is not None and bool(told.data)

    def state(self, name: str) -> str:
        """Return state and reason that `localizer` or `follower` said last; empty before."""
        status, _ = self.link.seen.told(name)
        return "" if status is None else f"{status.state} {status.reason}".strip()

    def describe(self) -> str:
        """Return what the nodes said last."""
        follower, _ = self.link.seen.told("follower")
        states = (
            f"{word} {self.state(name) or 'silent'}" for name, word in (("localizer", "localiser"), ("follower",) * 2)
        )
        return ", ".join(filter(None, (*states, follower and follower.remedy)))

    def _on_truth(self, message: Odometry) -> None:
        place, self.now_ns = message.pose.pose.position, stamp_ns(message)
        position = np.array([place.x, place.y])
        if self.position is not None:
            self.travelled += float(np.linalg.norm(position - self.position))
        self.position = position

    def __enter__(self) -> Self:
        """Return self."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Leave the domain."""
        self.link.close()
