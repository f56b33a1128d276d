"""Every parameter says what it means, in units that are spelled alike everywhere."""

import ast
import dataclasses
import importlib
from pathlib import Path
from typing import Any

import pytest

from architecture.tree import modules_with, parse
from sphere_nav.params import Leaf, leaves

pytestmark = pytest.mark.slow  # of the checks: `make check`

UNITS = {
    "": "",
    "m": "_m",
    "m^2": "",
    "m/s": "",
    "m/s^2": "",
    "m/s^3": "",
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
    "cd": "",
}
"""Units in use, each with the ending of a name that promises it."""


def declares_parameters(module: Path) -> bool:
    names = {item.name for node in ast.walk(parse(module)) if isinstance(node, ast.ImportFrom) for item in node.names}
    return "param" in names or "group" in names


def parameter_classes() -> list[type]:
    found = []
    for module in filter(declares_parameters, modules_with("sphere_nav.params import")):
        name = ".".join(module.with_suffix("").parts)
        items = vars(importlib.import_module(name)).values()
        found += [item for item in items if isinstance(item, type) and item.__module__ == name]
    return [item for item in found if dataclasses.is_dataclass(item) and hasattr(item, "__post_init__")]


LEAVES = [(f"{cls.__module__}.{cls.__name__}.{leaf.name}", leaf) for cls in parameter_classes() for leaf in leaves(cls)]
PROMISES = {ending: unit for unit, ending in UNITS.items() if ending}


def promised_unit(leaf: Leaf) -> str:
    """Return the unit that the ending of a parameter's name promises, else the one it has."""
    return next((unit for ending, unit in PROMISES.items() if leaf.name.endswith(ending)), leaf.unit)


def refusal(leaf: Leaf, value: Any) -> str:
    """Return why a value is refused, with the name of its parameter; empty where it is not."""
    try:
        leaf.check(value)
    except ValueError as error:
        return str(error)
    return ""


def test_every_parameter_is_documented() -> None:
    assert LEAVES
    assert [name for name, leaf in LEAVES if len(leaf.doc) < len("rows")] == []


def test_units_are_known_and_agree_with_the_name() -> None:
    wrong = [(name, leaf.unit) for name, leaf in LEAVES if leaf.unit not in UNITS or leaf.unit != promised_unit(leaf)]
    assert wrong == []


def test_defaults_lie_in_their_range() -> None:
    assert [text for _, leaf in LEAVES if (text := refusal(leaf, leaf.default))] == []
