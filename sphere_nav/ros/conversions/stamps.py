"""builtin_interfaces/Time and std_msgs/Header against integer nanoseconds."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

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
