"""The base that follower processes drive, as tests have it, by the clock and with a scanner."""

from __future__ import annotations

import time
from typing import Any

from sensor_msgs.msg import LaserScan

from sphere_nav.ros import qos
from worlds import base

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
