"""A message as bytes that depend on nothing but the message.

CDR aligns numbers to their size, and Fast CDR leaves the bytes between them as it found them in memory. What is stored
must not: two savings of one map are the same bytes, and nothing from the memory of a process goes into a file.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from node_kit.interfaces import schema_text, type_name


def serialize_to_store(message: Any) -> bytes:
    """Return the message in CDR with zeros between its fields."""
    name = type_name(type(message))
    store = _type_store(name)
    return bytes(store.serialize_cdr(store.deserialize_cdr(serialize_message(message), name), name))


@cache
def _type_store(name: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(name), name))
    return store
