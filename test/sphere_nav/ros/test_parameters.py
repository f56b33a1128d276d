"""A parameters class is declared with its meaning and its range, and read back."""

import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from sphere_nav.params import group, param, parameters
from sphere_nav.ros import live as kit
from sphere_nav.ros.rclpy_shell import RclpyShell


@parameters
class Inner:
    size: int = param(4, "size of something", "px", low=1, high=8)


@parameters
class Outer:
    rate: float = param(2.0, "how often", "Hz", low=0.1)
    mode: str = param("slow", "way of working", choices=("slow", "fast"))
    is_on: bool = param(True, "whether to work")
    inner: Inner = group(Inner)


@pytest.fixture
def make_node(ros):
    nodes = []

    def make(reason="", **values):
        overrides = [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
        nodes.append(Node("tested", parameter_overrides=overrides))
        kit.declare(nodes[-1], lambda: reason, Outer)
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


def test_defaults_and_overrides(make_node):
    assert RclpyShell.read_parameters(make_node(), Outer) == Outer()
    node = make_node(rate=3.5, inner__size=8, mode="fast", is_on=False)
    assert RclpyShell.read_parameters(node, Outer) == Outer(rate=3.5, inner=Inner(size=8), mode="fast", is_on=False)


def test_a_value_out_of_range_and_an_override_that_no_one_declared_are_named(make_node):
    for values, reason in [
        ({"rate": 0.0}, r"rate: expected at least 0\.1, found 0\.0"),
        ({"inner__size": 9}, r"inner\.size: expected 1 to 8, found 9"),
        ({"mode": "idle"}, "mode: expected one of 'slow', 'fast', found 'idle'"),
    ]:
        with pytest.raises(ValueError, match=reason):
            make_node(**values)
    node = make_node(raet=1.0, inner__size=2)
    assert kit.unknown_overrides(node) == ["raet: unknown parameter, ignored (is rate meant?)"]


def test_descriptors_tell_meaning_unit_and_range(make_node):
    node = make_node()
    rate = node.describe_parameter("rate")
    assert rate.description == "how often [Hz; at least 0.1]"
    assert rate.type == ParameterType.PARAMETER_DOUBLE
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (0.1, float("inf"))
    size = node.describe_parameter("inner.size")
    assert (size.integer_range[0].from_value, size.integer_range[0].to_value) == (1, 8)
    assert node.describe_parameter("mode").additional_constraints == "one of 'slow', 'fast'"


def test_setting_gives_the_reason(make_node):
    node = make_node(rate=3)  # as it is typed
    assert node.set_parameters([Parameter("rate", value=5.0)])[0].successful
    assert RclpyShell.read_parameters(node, Outer).rate == 5.0
    assert "one of 'slow', 'fast'" in node.set_parameters([Parameter("mode", value="idle")])[0].reason
    assert "Min: 0.1" in node.set_parameters([Parameter("rate", value=0.0)])[0].reason  # rclpy's own words
    fixed = make_node("not now")
    result = fixed.set_parameters([Parameter("rate", value=5.0)])[0]
    assert (result.successful, result.reason) == (False, "rate: not now")
