"""A topic that a node listens to: what has come, what was refused, and in words why nothing comes."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rclpy.qos import QoSProfile

from sphere_nav.ros import qos
from sphere_nav.ros.constants import LOG_PERIOD_S, SHARED_S
from sphere_nav.ros.conversions.headers import plain_frames
from sphere_nav.ros.interfaces import type_name
from sphere_nav.ros.service import one_line


def full_name(info: Any) -> str:
    """Return what the node of an endpoint is called, with its namespace."""
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


@dataclass
class Subscription:
    """One subscription of a node; `deliver` is what DDS or a replay calls."""

    topic: str
    kind: type[Any]
    callback: Callable[[Any], None]
    profile: QoSProfile
    is_required: bool = True
    silence: float = 2.0
    raw: bool = False
    entity_id: str = ""  # in qos_overrides.*, where a node has two subscriptions of a topic
    is_always: bool = False  # heard while the node is inactive, too
    source: str = ""  # listened to unless `topic` is remapped: that of a camera's driver, else the same
    log: Any = None
    num_received: int = 0
    num_refused: int = 0
    num_refused_in_row: int = 0
    num_lost: int = 0  # published, but never delivered: a queue overflowed, or the network dropped them
    num_lost_lately: int = 0
    last_refusal: str = ""
    last_arrival: float = 0.0  # time.monotonic()
    resolved: str = ""  # its full name, as it was remapped
    handle: Any = None  # the rclpy subscription, where there is one
    kept: list[Any] = field(default_factory=list)  # latched messages of the time before the node was active
    last_number: int = 0
    turned_back: deque[float] = field(default_factory=lambda: deque(maxlen=2))  # time.monotonic() where numbers did

    def deliver(self, message: Any) -> None:
        """Hand a message to the node. ValueError means: refused; the node goes on with the next one."""
        self.num_received += 1
        self.last_arrival = time.monotonic()
        try:
            self.callback(message if self.raw else plain_frames(message))
            self.num_refused_in_row = 0
        except ValueError as error:
            self.refuse(one_line(error))

    def refuse(self, reason: str) -> None:
        """Count a message that could not be used, and say why."""
        self.num_refused += 1
        self.num_refused_in_row += 1
        self.last_refusal = reason
        self.log.error(f"{self.topic}: refused: {reason}", every=LOG_PERIOD_S, key=f"refused {self.topic}")

    def keep(self, message: Any) -> None:
        """Keep a latched message until the node is active: nobody will send it again."""
        if self.profile.durability == qos.TRANSIENT_LOCAL:
            self.kept = [*self.kept, message][-max(self.profile.depth, 1) :]

    def count(self, number: int | None, num_publishers: int) -> None:
        """Count what was lost before the message of this sequence number; one publisher numbers without gaps."""
        if number is None:
            return
        if num_publishers == 1 and 0 < self.last_number < number:
            self.num_lost += number - self.last_number - 1
            self.num_lost_lately += number - self.last_number - 1
        if number <= self.last_number:
            self.turned_back.append(time.monotonic())
        self.last_number = number

    @property
    def is_of_one(self) -> bool:
        """Whether the numbers show that one publisher alone speaks: they turn back once where it began anew."""
        is_shared = len(self.turned_back) == 2 and time.monotonic() - self.turned_back[0] < SHARED_S
        return self.last_number > 0 and not is_shared

    @property
    def silent_for(self) -> float:
        """Seconds since the last message."""
        return time.monotonic() - self.last_arrival

    @property
    def is_missing(self) -> bool:
        """Whether the node lacks this topic now."""
        if not self.is_required:
            return False
        return self.num_received == 0 or (self.silence > 0 and self.silent_for > self.silence)

    def incompatible(self, publishers: Sequence[Any]) -> str:
        """Return which of the publishers DDS does not connect, and why; empty where there is none."""
        kind = type_name(self.kind)
        for info in publishers:
            who = full_name(info)
            if info.topic_type != kind:
                return f"{who} publishes {info.topic_type} there"
            reason = qos.mismatch(info.qos_profile, self.profile)
            if reason:
                return f"{who} is incompatible: {reason}"
        return ""

    def explain(self, topic: str, publishers: Sequence[Any]) -> str:
        """Return why nothing comes, given the resolved name and rclpy's TopicEndpointInfo of all publishers."""
        kind = type_name(self.kind)
        wanted = f"{topic} ({kind}; {qos.describe_policies(self.profile)})"
        if not publishers:
            return f"waiting for {wanted}: no publisher"
        reason = self.incompatible(publishers)
        if reason:
            return f"waiting for {wanted}: {reason}"
        count = f"{len(publishers)} publisher{'s' if len(publishers) > 1 else ''}"
        if self.num_received == 0:
            return f"waiting for {wanted}: {count}, no message yet"
        return f"waiting for {wanted}: {count}, no message for {self.silent_for:.1f} s"
