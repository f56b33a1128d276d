"""A message as bytes that depend on nothing but the message.

CDR aligns numbers to their size, and Fast CDR leaves the bytes between them as it found them in memory. What is stored
must not: two savings of one map are the same bytes, and nothing from the memory of a process goes into a file.
"""

from __future__ import annotations

from typing import Any

from rclpy.serialization import serialize_message

from sphere_nav.geometry.files.untrusted import printable
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.interfaces import type_name, type_store


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
