"""A parameter declared once: default, unit, range and meaning travel together.

`@parameters` makes a frozen dataclass whose fields are made by `param` (a value) or `group` (a nested class).
ROS declaration (sphere_nav.ros), the YAML in `config/` and the table in `docs/parameters.md` all derive from `leaves`.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import json
import math
import typing
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, dataclass_transform

from sphere_nav.params.homes import at_home

C = TypeVar("C")
SCALARS = (bool, int, float, str)


def param(
    default: Any,
    doc: str,
    unit: str = "",
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    is_live: bool = False,
) -> Any:
    """Declare one value; `low` and `high` are inclusive, `unit` is empty for pure numbers and words.

    `is_live`: it may change while the node works.
    """
    metadata = {"doc": doc, "unit": unit, "low": low, "high": high, "choices": choices, "is_live": is_live}
    return dataclasses.field(default=default, metadata=metadata)


def group(cls: type[C]) -> C:
    """Nest another parameters class; its fields become `name.field`."""
    return dataclasses.field(default_factory=cls)


@dataclass_transform(frozen_default=True, kw_only_default=True)
def parameters(cls: type[C]) -> type[C]:
    """Class decorator: a frozen, keyword-only dataclass that refuses values outside their range."""

    def check_fields(self: Any) -> None:
        for leaf in leaves(type(self)):
            if hasattr(self, leaf.name):  # those of groups have checked themselves
                leaf.check(getattr(self, leaf.name))

    cls.__post_init__ = check_fields  # type: ignore[attr-defined]
    return dataclasses.dataclass(frozen=True, kw_only=True)(cls)


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One value of a parameters class, by its dotted name."""

    name: str
    type: type
    default: Any
    doc: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    is_live: bool

    def check(self, value: Any) -> None:
        """Raise ValueError naming the parameter, what is expected and what was found."""
        kinds: tuple[type, ...] = (int, float) if self.type is float else (self.type,)
        is_of_kind = isinstance(value, kinds) and (self.type is bool or not isinstance(value, bool))
        if not is_of_kind:
            raise ValueError(f"{self.name}: expected {self.type.__name__}, found {value!r}")
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{self.name}: expected a finite number, found {value}")
        too_low = self.low is not None and value < self.low
        if too_low or (self.high is not None and value > self.high):
            raise ValueError(f"{self.name}: expected {self.range_text()}, found {value!r}")
        if self.choices and value not in self.choices:
            raise ValueError(f"{self.name}: expected {self.range_text()}, found {value!r}")

    def range_text(self) -> str:
        """Return the allowed values in words, or an empty string."""
        if self.choices:
            return "one of " + ", ".join(repr(choice) for choice in self.choices)
        if self.low is not None and self.high is not None:
            return f"{self.low} to {self.high}"
        if self.low is not None:
            return f"at least {self.low}"
        return f"at most {self.high}" if self.high is not None else ""

    def meaning(self) -> str:
        """Return the meaning with unit and range, as `ros2 param describe` shows it."""
        details = [text for text in (self.unit, self.range_text(), "live" if self.is_live else "") if text]
        return f"{self.doc} [{'; '.join(details)}]" if details else self.doc


def leaves(cls: Any) -> list[Leaf]:
    """Return every value of a parameters class, nested groups included, in order of declaration."""
    found: list[Leaf] = []
    for item, kind in _fields(cls):
        if hasattr(kind, "__dataclass_fields__"):
            found += (dataclasses.replace(leaf, name=f"{item.name}.{leaf.name}") for leaf in leaves(kind))
        elif kind in SCALARS:
            found.append(Leaf(name=item.name, type=kind, default=item.default, **item.metadata))
    return found


def build(cls: type[C], values: Mapping[str, Any]) -> C:
    """Construct `cls` from dotted names; unknown names and values out of range raise ValueError."""
    known = {leaf.name: leaf for leaf in leaves(cls)}
    for name, value in values.items():
        if name not in known:
            raise ValueError(f"{name}: unknown parameter{meant(name, known)}")
        known[name].check(value)
    arguments: dict[str, Any] = {}
    for item, kind in _fields(cls):  # type: ignore[arg-type]
        if hasattr(kind, "__dataclass_fields__"):
            group = f"{item.name}."
            inner = {name.removeprefix(group): value for name, value in values.items() if name.startswith(group)}
            arguments[item.name] = build(kind, inner)
        elif item.name in values:
            value = kind(values[item.name])
            arguments[item.name] = plain_frame(value) if item.name.endswith("frame") else at_home(value)
    return cls(**arguments)


def meant(name: str, known: Iterable[str]) -> str:
    """Return a hint at the known name that is most like one, or nothing."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" (is {close[0]} meant?)" if close else ""


def plain_frame(name: str) -> str:
    """Return the name of a frame as tf2 takes it: without the leading slash of ROS 1."""
    return name.lstrip("/")


def to_mapping(instance: Any) -> dict[str, Any]:
    """Return the values of a parameters object by dotted name, the inverse of `build`."""
    values: dict[str, Any] = {}
    for item in dataclasses.fields(instance):
        value = getattr(instance, item.name)
        if dataclasses.is_dataclass(value):
            values |= {f"{item.name}.{name}": inner for name, inner in to_mapping(value).items()}
        else:
            values[item.name] = value
    return values


@functools.cache
def _fields(cls: Any) -> list[tuple[dataclasses.Field[Any], Any]]:
    """Return the fields with their types; resolving their words takes longer than all else here."""
    hints = typing.get_type_hints(cls)
    return [(item, hints[item.name]) for item in dataclasses.fields(cls)]


def to_yaml(*classes: type) -> str:
    """Return a ROS 2 parameter file with every default of the classes, its meaning as comment above it."""
    lines = ["/**:", "  ros__parameters:"]
    open_groups: list[str] = []
    for leaf in (leaf for cls in classes for leaf in leaves(cls)):
        *groups, name = leaf.name.split(".")
        for depth, part in enumerate(groups):
            if open_groups[: depth + 1] != groups[: depth + 1]:
                lines.append("  " * (depth + 2) + f"{part}:")
        open_groups = groups
        indent = "  " * (len(groups) + 2)
        lines += [f"{indent}# {leaf.meaning()}", f"{indent}{name}: {_literal(leaf)}"]
    return "\n".join(lines) + "\n"


def to_markdown(cls: type) -> str:
    """Return a list with one line a parameter."""
    return "".join(f"- `{leaf.name}: {_literal(leaf)}`: {leaf.meaning()}\n" for leaf in leaves(cls))


def _literal(leaf: Leaf) -> str:
    if leaf.type is float:  # rclpy refuses an integer for a float parameter
        text = repr(float(leaf.default))
        return text if any(mark in text for mark in ".n") else text.replace("e", ".0e")
    return json.dumps(leaf.default)
