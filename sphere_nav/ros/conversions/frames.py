"""Names of frames as they are meant: without the leading slash of ROS 1."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from sphere_nav.params import plain_frame

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
