"""Every parameter says what it means, in units that are spelled alike everywhere."""

from __future__ import annotations

import ast
import dataclasses
import importlib
from pathlib import Path

import pytest

from architecture.tree import MODULES, parse
from typed_params import leaves

UNITS = {
    "": "",
    "m": "_m",
    "m/s": "",
    "m/s^2": "",
    "1/m": "",
    "1/m^2": "",
    "s": "_s",
    "Hz": "_hz",
    "rad": "_rad",
    "rad/s": "",
    "rad/s^2": "",
    "deg": "_deg",
    "px": "_px",
    "grey level": "",
    "standard deviations": "",
    "%": "",
    "x": "",
    "messages": "",
    "ms": "_ms",
    "B": "",
    "MB": "_mb",
}
"""Units in use, each with the ending of a name that promises it."""


def declares_parameters(module: Path) -> bool:
    names = {item.name for node in ast.walk(parse(module)) if isinstance(node, ast.ImportFrom) for item in node.names}
    return "param" in names or "group" in names


def parameter_classes() -> list[type]:
    found = []
    for module in filter(declares_parameters, MODULES):
        name = ".".join(module.with_suffix("").parts)
        items = vars(importlib.import_module(name)).values()
        found += [item for item in items if isinstance(item, type) and item.__module__ == name]
    return [item for item in found if dataclasses.is_dataclass(item) and hasattr(item, "__post_init__")]


CLASSES = parameter_classes()


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_every_parameter_is_documented(cls: type) -> None:
    assert [leaf.name for leaf in leaves(cls) if len(leaf.doc) < len("rows")] == []


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_units_are_known_and_agree_with_the_name(cls: type) -> None:
    endings = {ending: unit for unit, ending in UNITS.items() if ending}
    for leaf in leaves(cls):
        assert leaf.unit in UNITS, f"{leaf.name}: unknown unit {leaf.unit!r}"
        promised = next((unit for ending, unit in endings.items() if leaf.name.endswith(ending)), leaf.unit)
        assert leaf.unit == promised, f"{leaf.name}: {leaf.unit!r} instead of {promised!r}"


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_defaults_lie_in_their_range(cls: type) -> None:
    for leaf in leaves(cls):
        leaf.check(leaf.default)
