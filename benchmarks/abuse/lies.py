"""Messages of any ROS type that are right in type and wrong in all else, and bytes that are no message."""

from __future__ import annotations

import array
import importlib
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    AbstractSequence,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

BITS = {"int8": 8, "int16": 16, "int32": 32, "int64": 64}
FLOATS = (0.0, -0.0, 1.0, -1.0, 0.05, 1e9, -1e30, 5e-324, float("nan"), float("inf"), float("-inf"))
DOUBLES = (1.7e308, -1.7e308)
TEXTS: tuple[str, ...] = (
    "",
    ".",
    "map",
    "odom",
    "base_link",
    "/map",
    "cmd_vel",
    "mono8",
    "bgr8",
    "32FC1",
    "nothing",
    "~",
)
TEXTS += ("a\nb", "%s%n", "\u0000", "x\u0000y", "\ufffd", "\U0001f697" * 8, "\u202egnp.exe", "é" * 300, "[" * 40)
TEXTS += ("{}: !!x", "../x", "x" * 5000)
MARK = "@bad@"  # stands for bytes that are no UTF-8, in messages that are sent as bytes
NO_UTF8 = b"\xff\xc0\xfe\xed\xa0"  # of the same length
LENGTHS = (0, 0, 1, 2, 3, 5, 36, 1000)
MAX_DEPTH_LENGTH = 3  # elements of sequences of messages, each of which is filled
CHANCE_OF_NOW = 0.4  # of a stamp: otherwise most messages are refused for it alone


PARTS = {"SendGoal": "SendGoalService", "GetResult": "GetResultService", "FeedbackMessage": "FeedbackMessage"}


def interface_class(name: str) -> type[Any]:
    """Return the class of a type by its name, `std_msgs/msg/String`; the parts of an action, too."""
    package, kind, word = name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    if kind == "action" and not hasattr(module, word):
        name, _, part = word.partition("_")
        action = getattr(module, name)
        implied: type[Any] = getattr(action.Impl, PARTS[part]) if part in PARTS else getattr(action, part)
        return implied
    found: type[Any] = getattr(module, word)
    return found


class Liar:
    """Makes the messages; the same seed makes the same ones, but for the stamps of now."""

    def __init__(self, rng: np.random.Generator, words: Sequence[str] = ()) -> None:
        """`words` are names that mean something to who is lied to."""
        self._rng = rng
        self.words = list(words)

    def message(self, kind: type[Any]) -> Any:
        """Return a message of this class."""
        made = kind()
        if kind is Time and self._rng.random() < CHANCE_OF_NOW:
            made.sec, made.nanosec = divmod(time.time_ns(), 10**9)
            return made
        for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
            setattr(made, name, self._value(slot))
        return made

    def raw(self, message: Any) -> bytes:
        """Return a message as bytes: with text that is no UTF-8, some bytes changed, or its end missing."""
        data = bytearray(serialize_message(message).replace(MARK.encode(), NO_UTF8))
        choice = self._rng.random()
        if choice < 0.3:
            del data[int(self._rng.integers(0, len(data) + 1)) :]
        elif choice < 0.6:
            for _ in range(int(self._rng.integers(1, 9))):
                data[int(self._rng.integers(len(data)))] = int(self._rng.choice((0, 1, 127, 128, 255)))
        return bytes(data)

    def _pick(self, values: Sequence[Any]) -> Any:
        return values[int(self._rng.integers(len(values)))]

    def _value(self, slot: Any) -> Any:
        if isinstance(slot, BasicType):
            return self._basic(slot.typename)
        if isinstance(slot, AbstractGenericString):
            text = self._pick((*TEXTS, *self.words, MARK) if self._rng.random() < 0.6 or not self.words else self.words)
            return text[: slot.maximum_size] if slot.has_maximum_size() else text
        if isinstance(slot, NamespacedType):
            return self.message(interface_class("/".join(slot.namespaced_name())))
        assert isinstance(slot, AbstractNestedType)
        return self._sequence(slot)

    def _basic(self, name: str) -> Any:
        if name == "boolean":
            return bool(self._rng.random() < 0.5)
        if name == "octet":
            return bytes([int(self._rng.integers(256))])
        if name in ("float", "double"):
            return self._pick(FLOATS if name == "float" else FLOATS + DOUBLES)
        bits = BITS.get(name.removeprefix("u"), 8)
        low, high = (0, 2**bits) if name not in BITS else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        return int(self._pick((low, high - 1, 0, 1, 1, 2, 3, 4, 77, min(640, high - 1), max(-1, low))))

    def _sequence(self, slot: Any) -> Any:
        inner = slot.value_type
        if isinstance(slot, Array):
            length = slot.size
        else:
            assert isinstance(slot, AbstractSequence)
            length = self._pick(LENGTHS)
            if isinstance(inner, NamespacedType | AbstractGenericString):
                length = min(length, MAX_DEPTH_LENGTH)
            if isinstance(slot, BoundedSequence):
                length = min(length, slot.maximum_size)
        if isinstance(inner, BasicType) and inner.typename == "uint8":
            return array.array("B", self._rng.bytes(length)) if not isinstance(slot, Array) else self._array(slot)
        return self._array(slot) if isinstance(slot, Array) else [self._value(inner) for _ in range(length)]

    def _array(self, slot: Any) -> Any:
        return [self._value(slot.value_type) for _ in range(slot.size)]
