"""One message of a bag, and what a bag says about a topic.

The one error of files of messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from rclpy.qos import QoSProfile

SQLITE, ROS1 = ".db3", ".bag"  # ends of the names of files
SALVAGE = "to read what is whole: sqlite3 BAG.db3 .recover | sqlite3 NEW.db3, then ros2 bag reindex"


class BagError(ValueError):
    """What is wrong with a bag or a map, in one line: file, what was expected, what was found."""


class Recorded(NamedTuple):
    """One message of a bag: absolute topic, time of recording in ns, and the message (or its bytes)."""

    topic: str
    stamp_ns: int
    message: Any


@dataclass
class TopicInfo:
    """What a bag says about one of its topics."""

    name: str
    type: str
    count: int
    profile: QoSProfile  # as it was offered
    hash: str
