"""sphere_nav_msgs/LocalizationStatus against the status of either localiser."""

from __future__ import annotations

import enum
import math
from typing import Any

from sphere_nav_msgs.msg import LocalizationStatus

from sphere_nav.localization.status import State, Status
from sphere_nav.ros.conversions.stamps import header, stamp_ns

FLOATS = ("value", "limit", "quality", "p_chance", "overlap", "inlier_share", "mad", "milliseconds", "age")
WHOLE = ("iterations",)


def status_to_message(status: Any, stamp: int, frame_id: str) -> LocalizationStatus:
    """Return the message of anything with the fields of `Status`; state and reason are words or enums of words."""
    state, reason = _word(status.state), _word(status.reason)
    message = LocalizationStatus(header=header(stamp, frame_id), state=state, reason=reason)
    message.state_code = code_of(LocalizationStatus, state)
    message.reason_code = code_of(LocalizationStatus, reason) if reason else 0
    message.remedy, message.map_id = str(status.remedy), str(status.map_id)
    message.references = [int(number) for number in status.references]
    for name in FLOATS:
        number = float(getattr(status, name))
        worst = 1.0 if name == "p_chance" else 0.0
        setattr(message, name, number if math.isfinite(number) else worst)
    for name in WHOLE:
        setattr(message, name, int(getattr(status, name)))
    return message


def message_to_status(message: LocalizationStatus) -> Status:
    """Return what the message says; ValueError for a state that is not in the vocabulary."""
    code_of(LocalizationStatus, message.state)
    numbers: dict[str, Any] = {name: float(getattr(message, name)) for name in FLOATS}
    numbers |= {name: int(getattr(message, name)) for name in WHOLE}
    return Status(
        state=State(message.state),
        reason=message.reason,
        remedy=message.remedy,
        references=tuple(int(number) for number in message.references),
        **numbers,
        stamp_ns=stamp_ns(message),
        map_id=message.map_id,
    )


def _word(value: Any) -> str:
    return str(value.value if isinstance(value, enum.Enum) else value or "")


def code_of(kind: type[Any], word: str) -> int:
    """Return the number of a state or reason of a message type; ValueError for a word that it does not have."""
    code = getattr(kind, f"CODE_{word}", None)
    if code is None:
        raise ValueError(f"status: expected a state or reason of {kind.__name__}, found {word!r}")
    return int(code)
