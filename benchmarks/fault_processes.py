"""Follower processes and the base they drive; ended by a signal while they do: did the base see zero, and when?

A small process imports the node once and forks a follower for each signal, so that hundreds take minutes.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing.synchronize import Event as EventOfProcesses
from pathlib import Path
from typing import Any

import numpy as np

FORK = """
import os, subprocess, sys, time
import path_follower.ros.node as node
from path_follower.ros.front import LOOP
from path_follower.ros.loop_process import run_with_loop

class Front:
    def __init__(self, words, *descriptors):
        self.pid, self.status = os.fork(), None
        if self.pid == 0:
            for number in set(range(3, 256)) - set(descriptors):
                try:
                    os.close(number)
                except OSError:
                    pass
            os.environ[LOOP] = "%d %d" % descriptors
            os._exit(run_with_loop(node.PathFollowerNode, words))

    def wait(self, timeout=1e9):
        end = time.monotonic() + timeout
        while self.status is None:
            try:
                done, status = os.waitpid(self.pid, os.WNOHANG)
            except ChildProcessError:  # another thread has its status, and is about to say so
                done = 0
            if done:
                self.status = os.waitstatus_to_exitcode(status)
            elif time.monotonic() > end:
                raise subprocess.TimeoutExpired("front", timeout)
            else:
                time.sleep(0.01)
        return self.status

    def kill(self):
        if self.status is None:
            os.kill(self.pid, 9)

for line in sys.stdin:
    pid = os.fork()
    if pid == 0:
        os.dup2(2, 1)  # what the middleware prints is not taken for a pid
        os._exit(run_with_loop(node.PathFollowerNode, line.split(), Front))
    print(pid, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""
PERIOD = 0.1  # s between two poses
PATIENCE = 240.0  # s for a follower to come up and drive, on a busy machine
SETTLE = 1.0  # s for what keeps the machine busy to find the follower
CRUISE = 1.4  # m/s
DRIVING = 0.3  # m/s: fast enough to be ended
AFTER = 0.3  # s after the end of the process in which a last command may still arrive


def signalled(name: str, count: int, gate: EventOfProcesses | None = None) -> tuple[int, float]:
    """Send the signal to `count` driving followers; return how many left the base at zero, and the slowest in s.

    `gate` is set from when a follower drives until it has ended.
    """
    import rclpy

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "path.csv"
        path.write_text("\n".join(f"{x},0" for x in range(80)), encoding="utf-8")
        with subprocess.Popen([sys.executable, "-P", "-c", FORK], stdin=-1, stdout=-1, text=True) as nursery:
            rclpy.init()
            try:
                base = Base()
                words = f"--ros-args -p trajectory:={path} --log-level fatal"
                delays = [_end_by(getattr(signal, name), base, nursery, words, gate) for _ in range(count)]
                base.node.destroy_node()
            finally:
                rclpy.try_shutdown()
                assert nursery.stdin is not None
                nursery.stdin.close()
    return int(np.isfinite(delays).sum()), max(delays)


def _end_by(
    number: int, base: Base, nursery: subprocess.Popen[str], words: str, gate: EventOfProcesses | None
) -> float:
    """Let a follower drive, send it the signal; return the time until zero, infinite where the last was not."""
    assert nursery.stdin is not None
    assert nursery.stdout is not None
    nursery.stdin.write(words + "\n")
    nursery.stdin.flush()
    pid = int(nursery.stdout.readline())
    base.x = base.speed = 0.0
    try:
        base.drive_off(DRIVING)
        if gate is not None:
            gate.set()
            base.live(SETTLE)
    except RuntimeError:
        os.kill(pid, signal.SIGKILL)
        raise
    sent = time.monotonic()
    os.kill(pid, number)
    base.live(2.0 + AFTER, lambda: base.speed == 0.0 and time.monotonic() - sent > AFTER)
    nursery.stdout.readline()  # the process has ended
    base.live(AFTER)
    if gate is not None:
        gate.clear()
    return base.commands[-1][0] - sent if base.speed == 0.0 else float("inf")


class Base:
    """Says where it is, and obeys the last command."""

    def __init__(self, remap: str = "cmd_vel") -> None:
        import rclpy
        from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
        from sensor_msgs.msg import LaserScan
        from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus
        from std_msgs.msg import Bool
        from std_srvs.srv import Trigger

        from sphere_nav.ros import qos

        self.node = rclpy.create_node("base")
        self.node.create_subscription(Twist, remap, self._obey, qos.COMMAND)
        self.node.create_subscription(FollowerStatus, "path_follower/status", self._hear, qos.STATE)
        self.poses = self.node.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
        self.states = self.node.create_publisher(LocalizationStatus, "status", qos.STATE)
        self.button = self.node.create_publisher(Bool, "emergency_stop", qos.SENSOR)
        self.scans = self.node.create_publisher(LaserScan, "scan", qos.SENSOR)
        self.start, self.request = self.node.create_client(Trigger, "path_follower/start"), Trigger.Request()
        self.x = self.speed = self.worst_cycle = 0.0
        self.commands: list[tuple[float, float]] = []
        self.reason, self.state = "", "TRACKING"
        self.frame, self.value, self.is_silent, self.has_status = "map", 0.0, False, True
        self.is_pressed = False
        self.others: list[Any] = []
        self._due = self._told = time.monotonic()

    def _obey(self, message: Any) -> None:
        self.speed = message.linear.x
        self.commands.append((time.monotonic(), self.speed))

    def _hear(self, message: Any) -> None:
        self.reason = message.reason or self.reason
        self.worst_cycle = max(self.worst_cycle, message.worst_cycle)

    def live(self, seconds: float, is_done: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass until something is done; whether it was."""
        import rclpy

        end = time.monotonic() + seconds
        while time.monotonic() < end and not is_done():
            if time.monotonic() >= self._due:
                self._due += PERIOD
                self._due = max(self._due, time.monotonic() - PERIOD)
                self.speak()
            rclpy.spin_once(self.node, timeout_sec=max(min(self._due, end) - time.monotonic(), 0.001))
        return is_done()

    def speak(self) -> None:
        """Say where the base is, how the localiser is, and that the button is as it is."""
        from std_msgs.msg import Bool

        from sphere_nav.geometry import SE3
        from sphere_nav.localization.status import State, Status
        from sphere_nav.ros.conversions import se3_to_pose_with_covariance, status_to_message

        stamp = self.node.get_clock().now().nanoseconds
        now = time.monotonic()
        self.x, self._told = (
            self.x + self.speed * (now - self._told),
            now,
        )  # a car that is late to say it has moved, too
        self.button.publish(Bool(data=self.is_pressed))
        if self.has_status:
            self.states.publish(status_to_message(Status(State(self.state)), stamp, "map"))
        if not self.is_silent:
            pose = SE3.from_planar(self.x, 0.0, 0.0)
            message = se3_to_pose_with_covariance(pose, 1e-4 * np.eye(6), stamp, self.frame)
            message.pose.pose.position.y = self.value
            self.poses.publish(message)

    def drive_off(self, speed: float = 0.95 * CRUISE) -> None:
        """Start, again and again, until it drives as fast as that."""
        answer: Any = None
        asked = 0.0

        def is_driving() -> bool:
            nonlocal answer, asked
            if time.monotonic() - asked > 1.0 and self.start.service_is_ready() and self.speed == 0.0:
                answer, asked = self.start.call_async(self.request), time.monotonic()
            return self.speed > speed

        if not self.live(PATIENCE, is_driving):
            why = answer.result() if answer is not None and answer.done() else answer
            raise RuntimeError(f"path_follower: expected it to drive, found {self.reason!r}, start: {why}")
