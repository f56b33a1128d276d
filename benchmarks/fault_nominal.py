"""Hours of driving by a localiser that stands for `dense_localizer`: it knows the truth up to noise.

Vehicle, time and messages are simulated, without DDS: 10 poses a second, 50 ms late, a tenth of them lost.
"""

from __future__ import annotations

import resource
from pathlib import Path
from typing import Any

import numpy as np

from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState
from path_follower.ros.node import PathFollowerNode
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import poses_to_path, se3_to_pose_with_covariance, status_to_message

SECOND, STEP_NS, PERIOD_NS, LATENCY_NS = 1_000_000_000, 10_000_000, 100_000_000, 50_000_000
NOISE, YAW_NOISE = 0.01, 0.003  # m, rad
Image = list[tuple[str, Any]]  # what the localiser says to one image: topic and message


class Drive:
    """A straight drive at full speed; `dropped` is the share of the poses that are lost."""

    def __init__(self, seed: int, *, length: float = 200.0, dropped: float = 0.0) -> None:
        self.rng = np.random.default_rng(seed)
        self.bus = OfflineBus()
        self.node = self.bus.add(PathFollowerNode, {"enable_stamped_cmd_vel": True})
        self.vehicle = Vehicle(VehicleState(), CarParams(), ActuatorParams())
        self.command, self.now, self.dropped = VehicleCommand(), SECOND, dropped
        self.num_stops = 0
        self.pending: list[tuple[int, Image]] = []
        path = [(0, SE3.from_planar(x, 0.0, 0.0)) for x in np.arange(0.0, length, 0.5)]
        list(self.bus.advance(self.now))
        self.bus.deliver("/reference_path", poses_to_path(path, self.now, "map"))

    def say(self, pose: SE3) -> Image:
        """Return what the localiser says."""
        status = status_to_message(Status(State.TRACKING), self.now, "map")
        return [("/pose", se3_to_pose_with_covariance(pose, 1e-4 * np.eye(6), self.now, "map")), ("/status", status)]

    def see(self) -> SE3:
        """Return the true pose with noise."""
        s, noise = self.vehicle.state, self.rng.normal(size=3) * (NOISE, NOISE, YAW_NOISE)
        return SE3.from_planar(s.x + noise[0], s.y + noise[1], s.yaw + noise[2])

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + round(seconds * SECOND)
        while self.now < end:
            if self.now % PERIOD_NS == 0 and self.rng.random() >= self.dropped:
                self.pending.append((self.now + LATENCY_NS, self.say(self.see())))
            said = list(self.bus.advance(self.now))
            while self.pending and self.pending[0][0] <= self.now:
                for topic, message in self.pending.pop(0)[1]:
                    self.bus.deliver(topic, message)
                    said += self.bus.settle()
            for item in said:
                if item.topic == "/cmd_vel":
                    twist = item.message.twist
                    self._obey(twist.linear.x, twist.angular.z)
            self.vehicle.step(self.command, STEP_NS / SECOND)
            self.now += STEP_NS

    def _obey(self, speed: float, yaw_rate: float) -> None:
        self.num_stops += speed == 0.0 and self.command.speed != 0.0
        self.command = VehicleCommand(speed, yaw_rate)

    def start(self) -> str:
        """Arm; return why not."""
        answer = self.node.endpoints.call("start")  # type: ignore[attr-defined]
        return "" if answer.success else str(answer.message).partition(":")[0]


def nominal(hours: float) -> tuple[int, float, int]:
    """Drive with a tenth of the poses lost, on after each stop.

    Returns the stops, the growth of memory in MB/h and that of open files, both after a fifth.
    """
    drive = Drive(7, length=hours * 3600 * 1.4 + 50.0, dropped=0.1)
    drive.run(1.0)
    begin, num_parts = (0.0, 0), round(hours * 360)
    for part in range(num_parts):
        drive.start()
        drive.run(10.0)
        if part == num_parts // 5:
            begin = memory_mb(), num_files()
    return drive.num_stops, (memory_mb() - begin[0]) / (0.8 * hours), num_files() - begin[1]


def memory_mb() -> float:
    """Return the resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * resource.getpagesize() / 1e6


def num_files() -> int:
    """Return the number of open files of this process."""
    return len(list(Path("/proc/self/fd").iterdir()))
