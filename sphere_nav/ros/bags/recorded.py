"""One message of a bag, also as bytes, what a bag says about a topic, and the one error of files of messages.

CDR aligns numbers to their size, and Fast CDR leaves the bytes between them as it found them in memory. What is stored
must not: two savings of one map are the same bytes, and nothing from the memory of a process goes into a file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from sphere_nav.geometry.files.untrusted import printable
from sphere_nav.ros.interfaces import type_name, type_store

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


def serialize_to_store(message: Any) -> bytes:
    """Return the message in CDR with zeros between its fields."""
    name = type_name(type(message))
    store = type_store(name)
    return bytes(store.serialize_cdr(store.deserialize_cdr(serialize_message(message), name), name))


def view_message(data: memoryview, kind: type[Any], where: str) -> Any:
    """Return an object with the fields of a message whose arrays lie in `data`; BagError if the bytes are none.

    Nothing large is copied. rclpy copies each byte twice, and no other thread can run Python meanwhile.
    """
    name = type_name(kind)
    try:
        return type_store(name).deserialize_cdr(data, name)
    except Exception as error:  # whatever bytes of anyone lead to
        found = f"{len(data)} bytes that are none: {printable(str(error))}"
        raise BagError(f"{where}: expected {name}, found {found}") from None
