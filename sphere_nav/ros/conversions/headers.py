"""builtin_interfaces/Time and std_msgs/Header against integer nanoseconds, and frames as their names are meant."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from sphere_nav.params import plain_frame

SECOND = 1_000_000_000
MAX_STAMP_NS = 2**31 * SECOND - 1  # what a Time holds


def time_to_ns(time: Time) -> int:
    """Return nanoseconds; ValueError for what could not be sent on: before 1970, or seconds above 31 bits."""
    return checked(int(time.sec) * SECOND + int(time.nanosec))


def ns_to_time(ns: int) -> Time:
    """Return a Time; ValueError where its 32-bit seconds cannot hold it."""
    seconds, nanoseconds = divmod(checked(int(ns)), SECOND)
    return Time(sec=seconds, nanosec=nanoseconds)


def checked(ns: int) -> int:
    """Return nanoseconds that a Time of ours holds; ValueError for others."""
    if not 0 <= ns <= MAX_STAMP_NS:
        raise ValueError(f"stamp: expected 0 to 2^31 s, found {ns} ns")
    return ns


def header(ns: int, frame_id: str) -> Header:
    """Return a Header."""
    return Header(stamp=ns_to_time(ns), frame_id=frame_id)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message with a header."""
    return time_to_ns(message.header.stamp)


NAMES = ("frame_id", "child_frame_id")


def plain_frames(message: Any) -> Any:
    """Return a message, request or goal whose frames have lost their leading slashes; all that comes passes here."""
    kind: Any = type(message)
    for field in _fields(kind):
        value = getattr(message, field)
        if field in NAMES:
            setattr(message, field, plain_frame(value))
        else:
            for part in value if hasattr(value, "__len__") else (value,):
                plain_frames(part)
    return message


def check_frames(message: Any, frame_id: str, child_frame_id: str = "") -> None:
    """Raise ValueError unless a message is in a frame, and of a child frame where one is named."""
    if message.header.frame_id != frame_id:
        raise ValueError(f"header.frame_id: expected {frame_id!r}, found {message.header.frame_id!r}")
    if child_frame_id and message.child_frame_id != child_frame_id:
        raise ValueError(f"child_frame_id: expected {child_frame_id!r}, found {message.child_frame_id!r}")


@cache
def _fields(kind: type[Any]) -> tuple[str, ...]:
    """Return the fields of a type that are names of frames, or have some in them."""
    kinds = kind.get_fields_and_field_types()
    return tuple(field for field, text in kinds.items() if field in NAMES or _has_frames(text))


def _has_frames(text: str) -> bool:
    """Whether a field of a type as rclpy writes it, such as sequence<geometry_msgs/PoseStamped>, has frames in it."""
    name = text.removeprefix("sequence<").partition("[")[0].partition(",")[0].rstrip(">")
    package, _, kind = name.partition("/")
    return bool(kind) and bool(_fields(getattr(import_module(f"{package}.msg"), kind)))
