"""Names of frames as they are meant: without the leading slash of ROS 1."""

from __future__ import annotations

from typing import Any

HOLDERS = ("transforms", "poses")  # fields of messages whose items have headers of their own


def plain_frames(message: Any) -> Any:
    """Return a message after its frames have lost their leading slashes; every message that comes passes here."""
    parts = [message]
    for field in HOLDERS:
        parts += getattr(message, field, ())
    for part in parts:
        for owner, field in ((getattr(part, "header", None), "frame_id"), (part, "frame_id"), (part, "child_frame_id")):
            name = getattr(owner, field, "")
            if isinstance(name, str) and name.startswith("/"):
                setattr(owner, field, name.lstrip("/"))
    return message
