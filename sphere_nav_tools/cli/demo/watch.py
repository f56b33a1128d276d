"""A node that watches the drives of the demo: how far the car is, what the others say; it also gives the start."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from tqdm import tqdm

from sphere_nav.ros import qos
from sphere_nav.ros.conversions import stamp_ns
from sphere_nav_tools.cli.constants import LOOK, SILENCE, STALL
from sphere_nav_tools.cli.processes import Processes

SERVICES = ("path_follower/start", "cycab_sim/resume", "dense_localizer/reset")


class DriveFailed(RuntimeError):
    """A drive that did not get where it should; the message says what happened."""


class DriveMonitor:
    """Subscribes to the truth and to the states; `wait` spins until something holds."""

    def __init__(self, processes: Processes, domain_id: int) -> None:
        self.processes = processes
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.node = rclpy.create_node("demo_watch", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.travelled, self.now_ns = 0.0, 0
        self.position: np.ndarray | None = None
        self.is_taught = self.is_paused = False
        self.localizer, self.follower = "", ""
        self.remedy = ""
        subscribe = self.node.create_subscription
        subscribe(Odometry, "ground_truth/odometry", self._on_truth, qos.SENSOR)
        subscribe(Bool, "taught", self._on_taught, qos.LATCHED)
        subscribe(LocalizationStatus, "status", self._on_localizer, qos.STATE)
        subscribe(FollowerStatus, "path_follower/status", self._on_follower, qos.STATE)
        subscribe(Bool, "paused", self._on_paused, qos.LATCHED)
        self._clients = {name: self.node.create_client(Trigger, name) for name in SERVICES}

    def wait(self, what: str, holds: Callable[[], bool], is_moving: bool, bar: tqdm[Any] | None = None) -> None:
        """Spin until `holds`; DriveFailed where the car stands though it should move, by simulated time.

        Wall time alone ends nothing: after a long silence it is over if no process works any more.
        """
        alive, last, moved_ns, heard_ns = time.monotonic(), self.travelled, self.now_ns, self.now_ns
        while not holds():
            self.executor.spin_once(timeout_sec=LOOK)
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
                if not self.processes.find_busy():
                    raise DriveFailed(f"{what}: nothing for {SILENCE:.0f} s, and no process works; {self.describe()}")
                alive = time.monotonic()

    def wait_for(self, name: str) -> None:
        """Wait until a service is there."""
        self.wait(name, self._clients[name].service_is_ready, is_moving=False)

    def call(self, name: str) -> None:
        """Call a service; DriveFailed says why it was refused."""
        self.wait_for(name)
        future = self._clients[name].call_async(Trigger.Request())
        self.wait(name, future.done, is_moving=False)
        response = future.result()
        if response is None or not response.success:
            refusal = "no answer" if response is None else response.message or "no reason given"
            raise DriveFailed(f"{name} refused: {refusal}; {self.describe()}")

    def describe(self) -> str:
        """Return what the nodes said last."""
        states = (f"localiser {self.localizer or 'silent'}", f"follower {self.follower or 'silent'}", self.remedy)
        return ", ".join(state for state in states if state)

    def _on_truth(self, message: Odometry) -> None:
        place, self.now_ns = message.pose.pose.position, stamp_ns(message)
        position = np.array([place.x, place.y])
        if self.position is not None:
            self.travelled += float(np.linalg.norm(position - self.position))
        self.position = position

    def _on_taught(self, message: Bool) -> None:
        self.is_taught = message.data

    def _on_paused(self, message: Bool) -> None:
        self.is_paused = message.data

    def _on_localizer(self, message: LocalizationStatus) -> None:
        self.localizer = f"{message.state} {message.reason}".strip()

    def _on_follower(self, message: FollowerStatus) -> None:
        self.follower, self.remedy = f"{message.state} {message.reason}".strip(), message.remedy

    def __enter__(self) -> Self:
        """Return self."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Leave the domain."""
        self.executor.shutdown(timeout_sec=0.5)
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
