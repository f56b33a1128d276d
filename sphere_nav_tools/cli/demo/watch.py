"""The nodes of a drive of the demo, and a watch over them: how far the car is, what they say."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from tqdm import tqdm

from sphere_nav.geometry.arrays import arc_lengths
from sphere_nav.ros import qos
from sphere_nav_tools.cli.constants import LOOK_S, SILENCE
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.processes import Processes

BAR = "{desc}: {percentage:3.0f}% |{bar}| {n:.0f} of {total:.0f} m, {elapsed}, {remaining} left"
SERVICES = ("cycab_sim/resume", "dense_localizer/reset")  # beside those that an operator's page calls


class WatchedDrive(Processes):
    """Processes in a domain, and a link to them; `wait` lasts until something holds."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        super().__init__(folder, domain_id)
        self.link = Link(domain_id=domain_id)
        node = self.link.node
        for name in ("taught", "paused"):
            node.create_subscription(Bool, name, partial(self.link.seen.hear, name), qos.LATCHED)
        self.link.clients |= {name: node.create_client(Trigger, name) for name in SERVICES}

    def wait(self, what: str, holds: Callable[[], bool], length: float = 0.0) -> None:
        """Wait until something holds, and show how much of a length the wheels have driven, m.

        RuntimeError where a process ends, or the car stands for long.
        """
        begun, is_hidden = time.monotonic(), None if length else True  # None: where there is no terminal
        with tqdm(total=round(length), desc=what, bar_format=BAR, mininterval=0.5, disable=is_hidden) as bar:
            while not holds():
                time.sleep(LOOK_S)
                self.check()
                way, age = self.link.seen.told("way by wheels")
                if way:
                    bar.update(min(arc_lengths(way)[-1], bar.total) - bar.n)
                if min(age, time.monotonic() - begun) > SILENCE:
                    raise RuntimeError(f"{what}: the car has not moved for {SILENCE:.0f} s; {self.describe()}")

    def wait_for(self, name: str) -> None:
        """Wait until a service is there."""
        self.wait(name, self.link.clients[name].service_is_ready)

    def call(self, name: str) -> None:
        """Call a service; RuntimeError says why it was refused."""
        self.wait_for(name)
        if refusal := self.link.call(name, SILENCE):
            raise RuntimeError(f"{name} refused: {refusal}; {self.describe()}")

    def has_told(self, name: str) -> bool:
        """Whether the simulator says that it is so: `taught`, `paused`."""
        told, _ = self.link.seen.told(name)
        return told is not None and bool(told.data)

    def state(self, name: str) -> str:
        """Return state and reason that `localizer` or `follower` said last."""
        status, _ = self.link.seen.told(name)
        return "silent" if status is None else f"{status.state} {status.reason}".strip()

    def describe(self) -> str:
        """Return what the nodes said last."""
        follower, _ = self.link.seen.told("follower")
        remedy = f", {follower.remedy}" if follower and follower.remedy else ""
        return f"localiser {self.state('localizer')}, follower {self.state('follower')}{remedy}"

    def end(self) -> dict[str, int]:
        """End what still runs, and leave the domain."""
        self.link.close()
        return super().end()
