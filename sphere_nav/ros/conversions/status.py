"""The status messages against what they tell: a field of a message is the value of that name, of plain kinds."""

from __future__ import annotations

import enum
import math
from dataclasses import fields
from typing import Any, TypeVar

from sphere_nav_msgs.msg import LocalizationStatus

from sphere_nav.localization.status import State, Status
from sphere_nav.ros.conversions.headers import header, stamp_ns

M = TypeVar("M", bound=Any)
FACTS = ("reason", "value", "limit")  # of a Verdict


def told(message: M, source: Any, *names: str) -> M:
    """Return the message with what a source has by the names of its fields; what is not finite stays as it was.

    All that are bool, int, float or str and that the source has; or those of some names.
    """
    for name in names or [name for name in message.get_fields_and_field_types() if hasattr(source, name)]:
        kind, value = type(getattr(message, name)), getattr(source, name)
        if kind is str:
            value = (value.value if isinstance(value, enum.Enum) else value) or ""
        if kind in (bool, int, float, str) and not (kind is float and not math.isfinite(value)):
            setattr(message, name, kind(value))
    return message


def with_codes(message: M) -> M:
    """Return the message with the numbers of its words; ValueError for a word that it does not have."""
    for name in ("state", "reason"):
        word = getattr(message, name)
        if hasattr(message, f"{name}_code") and (word or name == "state"):
            setattr(message, f"{name}_code", code_of(type(message), word))
    return message


def status_to_message(status: Any, stamp: int, frame_id: str) -> LocalizationStatus:
    """Return the message of anything with the fields of `Status`; state and reason are words or enums of words."""
    message = LocalizationStatus(header=header(stamp, frame_id), p_chance=1.0)
    message.references = [int(number) for number in status.references]
    return with_codes(told(message, status))


def message_to_status(message: LocalizationStatus) -> Status:
    """Return what the message says; ValueError for a state that is not in the vocabulary."""
    code_of(LocalizationStatus, message.state)
    values = {item.name: getattr(message, item.name) for item in fields(Status) if hasattr(message, item.name)}
    values |= {"state": State(message.state), "references": tuple(int(number) for number in message.references)}
    return Status(**values, stamp_ns=stamp_ns(message))


def code_of(kind: type[Any], word: str) -> int:
    """Return the number of a state or reason of a message type; ValueError for a word that it does not have."""
    code = getattr(kind, f"CODE_{word}", None)
    if code is None:
        raise ValueError(f"status: expected a state or reason of {kind.__name__}, found {word!r}")
    return int(code)
