from __future__ import annotations

import dataclasses
import re

import pytest
import yaml

from architecture.tree import flatten
from sphere_nav.params import build, group, leaves, param, parameters, to_mapping, to_yaml


@parameters
class Inner:
    gain: float = param(0.5, "how much", "1/m", low=0.0, high=2.0)
    mode: str = param("slow", "how fast", choices=("slow", "fast"))


@parameters
class Outer:
    count: int = param(3, "how many", low=1)
    is_on_track: bool = param(True, "whether it is")
    inner: Inner = group(Inner)


def test_leaves_come_in_order_with_dotted_names_and_their_meaning_tells_unit_and_range() -> None:
    assert [leaf.name for leaf in leaves(Outer)] == ["count", "is_on_track", "inner.gain", "inner.mode"]
    assert [leaf.type for leaf in leaves(Outer)] == [int, bool, float, str]
    meanings = [leaf.meaning() for leaf in leaves(Outer)]
    inner = ["how much [1/m; 0.0 to 2.0]", "how fast [one of 'slow', 'fast']"]
    assert meanings == ["how many [at least 1]", "whether it is", *inner]


def test_build_is_the_inverse_of_to_mapping_with_defaults_floats_and_bounds() -> None:
    values = {"count": 7, "is_on_track": False, "inner.gain": 1.5, "inner.mode": "fast"}
    assert to_mapping(build(Outer, values)) == values
    assert build(Outer, {"inner.gain": 1.0}) == Outer(inner=Inner(gain=1.0))
    gain = build(Outer, {"inner.gain": 1}).inner.gain
    assert isinstance(gain, float)
    assert gain == 1.0
    built = [build(Outer, {"inner.gain": value, "count": 1}) for value in (0.0, 2.0)]
    assert [(item.inner.gain, item.count) for item in built] == [(0.0, 1), (2.0, 1)]


def test_a_wrong_value_is_refused_by_name_by_the_constructor_too_and_none_can_be_changed() -> None:
    for name, value, text in [
        ("count", 0, "count: expected at least 1, found 0"),
        ("count", True, "count: expected int, found True"),
        ("inner.gain", 2.5, "inner.gain: expected 0.0 to 2.0, found 2.5"),
        ("inner.gain", "1", "inner.gain: expected float, found '1'"),
        ("inner.gian", 1, "inner.gian: unknown parameter (is inner.gain meant?)"),
    ]:
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            build(Outer, {name: value})
    with pytest.raises(ValueError, match=r"gain: expected 0\.0 to 2\.0, found -1\.0"):
        Inner(gain=-1.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        Outer().count = 4  # type: ignore[misc]


@parameters
class Deep:
    tiny: float = param(1e-9, "a very small number", "m")
    word: str = param("yes", "a word that YAML takes for a truth value")


@parameters
class Middle:
    deep: Deep = group(Deep)
    after: float = param(1e20, "a very large number", "s")


@parameters
class Whole:
    whole: float = param(2, "declared as an integer", "m", low=0.0)
    middle: Middle = group(Middle)
    flag: bool = param(True, "a truth value")


def test_the_yaml_file_holds_every_default_with_its_type() -> None:
    tree = yaml.safe_load(to_yaml(Whole))
    values = flatten(tree["/**"]["ros__parameters"])
    assert values == to_mapping(Whole())
    # rclpy refuses an integer for a float parameter, so floats must be written as floats
    assert [type(values[leaf.name]) for leaf in leaves(Whole)] == [leaf.type for leaf in leaves(Whole)]
    assert build(Whole, values) == Whole()
