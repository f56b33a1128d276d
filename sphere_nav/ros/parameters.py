"""A parameters class (sphere_nav.params) as declared ROS parameters, and back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from sphere_nav.params import Leaf, leaves, meant

CLOCK_CHOICE = "use_sim_time"  # of rclpy; silence is judged by that clock


def declare(node: Node, why_fixed: Callable[[], str], *classes: type[Any]) -> None:
    """Declare every value of some classes; ValueError names an override out of range, expected and found.

    `why_fixed` is asked when somebody later sets a parameter that is not live, or chooses another clock: a reason
    refuses it, "" allows it. rclpy asks what was added last first: what it does itself comes at the end.
    """
    known = {leaf.name: leaf for cls in classes for leaf in leaves(cls)}
    for name, leaf in known.items():
        value = _override(node, leaf)
        leaf.check(value)
        told = ParameterDescriptor(description=leaf.meaning(), additional_constraints=leaf.range_text())
        node.declare_parameter(name, value, told, ignore_override=True)

    def judge(changes: list[Parameter]) -> SetParametersResult:
        ours = [change for change in changes if change.name in known]
        try:
            for change in ours:
                known[change.name].check(change.value)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        live = {name for name, leaf in known.items() if leaf.is_live}
        fixed = [change.name for change in changes if change.name in (known.keys() | {CLOCK_CHOICE}) - live]
        reason = why_fixed() if fixed else ""
        return SetParametersResult(successful=not reason, reason=f"{fixed[0]}: {reason}" if reason else "")

    node.add_on_set_parameters_callback(judge)


def unknown_overrides(node: Node) -> list[str]:
    """Return one line for every override that no one declared; rclpy keeps those without a word."""
    declared = list(node.get_parameters_by_prefix("")) if node._parameters else []
    names = [name for name in node._parameter_overrides if not node.has_parameter(name)]
    ours = [name for name in names if not name.startswith("qos_overrides.")]
    return [f"{name}: unknown parameter, ignored{meant(name, declared)}" for name in ours]


def _override(node: Node, leaf: Leaf) -> Any:
    given = node._parameter_overrides.get(leaf.name)
    value = leaf.default if given is None else given.value
    is_whole_number = leaf.type is float and isinstance(value, int) and not isinstance(value, bool)
    return float(value) if is_whole_number else value
