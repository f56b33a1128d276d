"""Follower processes that are ended by a signal while they drive: did the vehicle see zero, and when?

A small process imports the node once and forks a follower for each signal, so that hundreds take minutes.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

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
            done, status = os.waitpid(self.pid, os.WNOHANG)
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
PATIENCE = 60.0  # s for a follower to come up and drive
ANSWER = 1.0  # s to wait for the answer of a call
AFTER = 0.3  # s after the end of the process in which a last command may still arrive


def signalled(name: str, count: int) -> tuple[int, float]:
    """Send the signal to `count` driving followers; return how many left the vehicle at zero, and the slowest in s."""
    import rclpy

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "path.csv"
        path.write_text("\n".join(f"{x},0" for x in range(80)), encoding="utf-8")
        with subprocess.Popen([sys.executable, "-P", "-c", FORK], stdin=-1, stdout=-1, text=True) as nursery:
            rclpy.init()
            try:
                vehicle = _Vehicle(nursery, f"--ros-args -p trajectory:={path} --log-level fatal")
                delays = [vehicle.end_by(getattr(signal, name)) for _ in range(count)]
                vehicle.node.destroy_node()
            finally:
                rclpy.try_shutdown()
                assert nursery.stdin is not None
                nursery.stdin.close()
    return sum(np.isfinite(delays)), max(delays)


class _Vehicle:
    """Publishes poses, obeys commands, remembers when the last one came."""

    def __init__(self, nursery: subprocess.Popen[str], arguments: str) -> None:
        import rclpy
        from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
        from sphere_nav_msgs.msg import LocalizationStatus
        from std_srvs.srv import Trigger

        from sphere_nav.ros import qos

        self.nursery, self.arguments = nursery, arguments
        self.node = rclpy.create_node("vehicle")
        self.node.create_subscription(Twist, "cmd_vel", self._obey, qos.COMMAND)
        self.poses = self.node.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
        self.states = self.node.create_publisher(LocalizationStatus, "status", qos.STATE)
        self.start, self.request = self.node.create_client(Trigger, "path_follower/start"), Trigger.Request()
        self.x = self.speed = self.arrival = 0.0

    def _obey(self, message: object) -> None:
        self.speed, self.arrival = message.linear.x, time.monotonic()  # type: ignore[attr-defined]

    def end_by(self, number: int) -> float:
        """Let a follower drive, send it the signal; return the time until zero, infinite where the last was not."""
        stdin, stdout = self.nursery.stdin, self.nursery.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(self.arguments + "\n")
        stdin.flush()
        pid = int(stdout.readline())
        self.x = self.speed = 0.0
        try:
            self._drive_up()
        except RuntimeError:
            os.kill(pid, signal.SIGKILL)
            raise
        sent = time.monotonic()
        os.kill(pid, number)
        while not (self.speed == 0.0 and time.monotonic() - sent > AFTER) and time.monotonic() - sent < 2.0 + AFTER:
            self._spin(0.01)
        stdout.readline()  # the process has ended
        self._spin(AFTER)
        return self.arrival - sent if self.speed == 0.0 else float("inf")

    def _drive_up(self) -> None:
        end, answer, asked = time.monotonic() + PATIENCE, None, 0.0
        while self.speed < 0.3:
            if time.monotonic() > end:
                why = answer.result().message if answer is not None and answer.done() else "no answer of start"
                raise RuntimeError(f"path_follower: expected it to drive, found it standing: {why}")
            self._speak()
            self._spin(0.04)
            is_late = time.monotonic() - asked > ANSWER  # asked a follower that has ended
            is_refused = answer is not None and answer.done() and not answer.result().success
            if self.start.service_is_ready() and (answer is None or is_late or is_refused):
                answer, asked = self.start.call_async(self.request), time.monotonic()

    def _speak(self) -> None:
        from sphere_nav.geometry import SE3
        from sphere_nav.localization.status import State, Status
        from sphere_nav.ros.conversions import se3_to_pose_with_covariance, status_to_message

        stamp = self.node.get_clock().now().nanoseconds
        self.x += self.speed * 0.04
        self.states.publish(status_to_message(Status(State.TRACKING), stamp, "map"))
        pose = SE3.from_planar(self.x, 0.0, 0.0)
        self.poses.publish(se3_to_pose_with_covariance(pose, 1e-4 * np.eye(6), stamp, "map"))

    def _spin(self, seconds: float) -> None:
        import rclpy

        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            rclpy.spin_once(self.node, timeout_sec=left)
