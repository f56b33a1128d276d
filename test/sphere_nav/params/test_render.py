from __future__ import annotations

import yaml

from architecture.tree import flatten
from sphere_nav.params import build, group, leaves, param, parameters, to_mapping
from sphere_nav.params.render import to_yaml


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
    tree = yaml.safe_load(to_yaml(Whole, node="some_node"))
    values = flatten(tree["some_node"]["ros__parameters"])
    assert values == to_mapping(Whole())
    # rclpy refuses an integer for a float parameter, so floats must be written as floats
    assert [type(values[leaf.name]) for leaf in leaves(Whole)] == [leaf.type for leaf in leaves(Whole)]
    assert build(Whole, values) == Whole()
