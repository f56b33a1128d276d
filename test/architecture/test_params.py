"""Every parameter says what it means, in units that are spelled alike everywhere."""

from __future__ import annotations

import dataclasses
import importlib

import pytest

from architecture.tree import MODULES
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
    "ms": "_ms",
    "B": "",
    "MB": "_mb",
}
"""Units in use, each with the ending of a name that promises it."""


def parameter_classes() -> list[type]:
    names = [".".join(module.with_suffix("").parts) for module in MODULES if module.name == "params.py"]
    return [
        item
        for name in names
        for item in vars(importlib.import_module(name)).values()
        if dataclasses.is_dataclass(item) and isinstance(item, type) and item.__module__ == name
    ]


CLASSES = parameter_classes()


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_every_parameter_is_documented(cls: type) -> None:
    assert [leaf.name for leaf in leaves(cls) if len(leaf.doc.split()) < 2] == []


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
