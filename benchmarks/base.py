"""The base that follower processes drive, as tests have it, by the clock and with a scanner."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from sensor_msgs.msg import LaserScan

from sphere_nav.geometry.arrays import Array
from sphere_nav.ros import conversions, qos
from worlds import base

LENGTH = 400  # m of the path: a base is never put back
PATIENCE = 240.0  # s for a follower to come up and drive, on a busy machine
SETTLE = 1.0  # s for what keeps the machine busy to find the follower


class Clock:
    """Ends after some seconds, whatever else the machine does."""

    def __init__(self, seconds: float) -> None:
        self._end = time.monotonic() + seconds

    def is_left(self) -> bool:
        """Whether to wait on."""
        return time.monotonic() < self._end


class Base(base.Base):
    """Says where it is, and obeys the last command."""

    patience = Clock

    def __init__(self) -> None:
        super().__init__()
        self.scans = self.node.create_publisher(LaserScan, "scan", qos.SENSOR)
        self.others: list[Any] = []

    def scan(self, ranges: Array, step: float) -> None:
        """Say what the scanner sees ahead, to both sides of it alike, by rays so many rad apart."""
        half, header = step * (len(ranges) - 1) / 2, conversions.header(time.time_ns(), "laser")
        scan = LaserScan(header=header, angle_min=-half, angle_max=half, angle_increment=step, range_min=0.1)
        scan.range_max, scan.ranges = 30.0, ranges.tolist()
        self.scans.publish(scan)


def write_straight(folder: Path) -> Path:
    """Write a straight path into a folder, and return its file."""
    path = folder / "path.csv"
    path.write_text("\n".join(f"{x},0" for x in range(LENGTH)), encoding="utf-8")
    return path
