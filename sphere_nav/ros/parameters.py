"""A parameters class (sphere_nav.params) as declared ROS parameters, and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from sphere_nav.params import Leaf, leaves, meant
from sphere_nav.ros.executor import CallbackFailures
from sphere_nav.ros.service import one_line

KINDS: dict[type[Any], tuple[str, type[Any], float]] = {  # ranges in a descriptor, and the largest number
    float: ("floating_point_range", FloatingPointRange, math.inf),
    int: ("integer_range", IntegerRange, 2**63 - 1),
}
CLOCK_CHOICE = "use_sim_time"  # of rclpy; silence is judged by that clock


def declare(node: Node, why_fixed: Callable[[], str], *classes: type[Any]) -> None:
    """Declare every value of some classes; ValueError names an override out of range, expected and found.

    `why_fixed` is asked when somebody later sets a parameter that is not live, or chooses another clock: a reason
    refuses it, "" allows it. rclpy asks what was added last first: what it does itself comes at the end.
    """
    known = {leaf.name: leaf for cls in classes for leaf in leaves(cls)}
    for name, leaf in known.items():
        given = node._parameter_overrides.get(name)
        value = leaf.default if given is None else given.value
        if leaf.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        leaf.check(value)
        node.declare_parameter(name, value, _descriptor(leaf), ignore_override=True)

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


def answer_wrong_types(node: Node, failures: CallbackFailures) -> None:
    """Have every request to set parameters answered, also where rclpy raises.

    An unknown type of a parameter, for one, is a ValueError, and who asked would wait for ever.
    """

    def set_together(parts: Sequence[Any]) -> SetParametersResult:
        try:
            return node.set_parameters_atomically(list(map(Parameter.from_parameter_msg, parts)))
        except Exception as error:
            names = ", ".join(part.name for part in parts)
            if not isinstance(error, ValueError | ParameterException):  # else what was asked for is wrong
                failures.add(error, "parameters")
            return SetParametersResult(successful=False, reason=one_line(ValueError(f"{names}: {one_line(error)}")))

    def one_by_one(request: Any, response: Any) -> Any:
        response.results = [set_together([part]) for part in request.parameters]
        return response

    def at_once(request: Any, response: Any) -> Any:
        response.result = set_together(request.parameters)
        return response

    setters = {SetParameters: one_by_one, SetParametersAtomically: at_once}
    for service in node.services:
        service.callback = setters.get(service.srv_type, service.callback)


def unknown_overrides(node: Node) -> list[str]:
    """Return one line for every override that no one declared; rclpy keeps those without a word."""
    declared = list(node.get_parameters_by_prefix("")) if node._parameters else []
    names = [name for name in node._parameter_overrides if not node.has_parameter(name)]
    ours = [name for name in names if not name.startswith("qos_overrides.")]
    return [f"{name}: unknown parameter, ignored{meant(name, declared)}" for name in ours]


def _descriptor(leaf: Leaf) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=leaf.meaning(), additional_constraints=leaf.range_text())
    if leaf.low is None and leaf.high is None:
        return descriptor
    name, kind, most = KINDS[leaf.type]
    low, high = (-most if leaf.low is None else leaf.low), (most if leaf.high is None else leaf.high)
    setattr(descriptor, name, [kind(from_value=leaf.type(low), to_value=leaf.type(high))])
    return descriptor
