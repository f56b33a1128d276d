"""A parameters class (sphere_nav.params) as declared ROS parameters, and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from sphere_nav.params import Leaf, build, leaves, meant
from sphere_nav.ros.executor import CallbackFailures
from sphere_nav.ros.service import Handler, one_line

C = TypeVar("C")
MAX_INTEGER = 2**63 - 1
MAX_NAME = 100  # characters of a name that are repeated in an answer
CLOCK_CHOICE = "use_sim_time"


def declare(node: Node, cls: type[Any], why_fixed: Callable[[], str] = lambda: "") -> None:
    """Declare every value of `cls`; an override out of range raises ValueError naming parameter, expected and found.

    `why_fixed` is asked when somebody later sets a parameter that is not live: a reason refuses it, "" allows it.
    """
    known = {leaf.name: leaf for leaf in leaves(cls)}
    for name, leaf in known.items():
        value = _override(node, leaf)
        leaf.check(value)
        node.declare_parameter(name, value, _descriptor(leaf), ignore_override=True)

    def judge(changes: list[Parameter]) -> SetParametersResult:
        ours = [change for change in changes if change.name in known]
        try:
            for change in ours:
                known[change.name].check(change.value)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        fixed = [change.name for change in ours if not known[change.name].is_live]
        reason = why_fixed() if fixed else ""
        return SetParametersResult(successful=not reason, reason=f"{fixed[0]}: {reason}" if reason else "")

    node.add_on_set_parameters_callback(judge)


def fix_clock(node: Node, why_fixed: Callable[[], str]) -> None:
    """Refuse another clock while `why_fixed` gives a reason: silence is judged by it. Refuse odd names.

    rclpy asks the callback that was added last first and the one that changes the clock, its own, at the end.
    """

    def judge(changes: list[Parameter]) -> SetParametersResult:
        names = [change.name for change in changes]
        if len(set(names)) < len(names):  # rclpy would act on the first value and keep the last one
            twice = next(name for name in names if names.count(name) > 1)
            return SetParametersResult(successful=False, reason=f"{twice}: expected one value, found several")
        if "" in names:  # rclpy would take it for declared
            return SetParametersResult(successful=False, reason="parameter: expected a name, found none")
        reason = why_fixed() if CLOCK_CHOICE in names else ""
        return SetParametersResult(successful=not reason, reason=f"{CLOCK_CHOICE}: {reason}" if reason else "")

    node.add_on_set_parameters_callback(judge)


def answer_wrong_types(node: Node, failures: CallbackFailures) -> None:
    """Have every request to set parameters answered, each parameter by itself, also where rclpy raises.

    An unknown type of a parameter, for one, is a ValueError, and who asked would wait for ever.
    """
    for service in node.services:
        if service.srv_type is SetParameters:
            service.callback = _one_by_one(service.callback, failures)
        elif service.srv_type is SetParametersAtomically:
            service.callback = _at_once(service.callback, failures)


def _one_by_one(handler: Handler, failures: CallbackFailures) -> Handler:
    def answer(request: Any, response: Any) -> Any:
        for parameter in request.parameters:
            try:
                part = handler(SetParameters.Request(parameters=[parameter]), SetParameters.Response())
                response.results.extend(part.results)
            except Exception as error:
                response.results.append(_refusal(error, parameter.name, failures))
        return response

    return answer


def _at_once(handler: Handler, failures: CallbackFailures) -> Handler:
    def answer(request: Any, response: Any) -> Any:
        try:
            return handler(request, response)
        except Exception as error:
            response.result = _refusal(error, "set_parameters_atomically", failures)
            return response

    return answer


def _refusal(error: Exception, name: str, failures: CallbackFailures) -> SetParametersResult:
    failures.add(error, f"parameter {name[:MAX_NAME]}", is_request=isinstance(error, ValueError | OSError))
    return SetParametersResult(successful=False, reason=f"{name[:MAX_NAME]}: {one_line(error)}")


def read(node: Node, cls: type[C]) -> C:
    """Return the parameters object with the present values of the declared parameters."""
    return build(cls, {leaf.name: node.get_parameter(leaf.name).value for leaf in leaves(cls)})


def unknown_overrides(node: Node) -> list[str]:
    """Return one line for every override that no one declared; rclpy keeps those without a word."""
    declared = list(node.get_parameters_by_prefix("")) if node._parameters else []
    names = [name for name in node._parameter_overrides if not node.has_parameter(name)]
    return [_hint(name, declared) for name in names if not name.startswith("qos_overrides.")]


def _hint(name: str, declared: Iterable[str]) -> str:
    return f"{name}: unknown parameter, ignored{meant(name, declared)}"


def _override(node: Node, leaf: Leaf) -> Any:
    given = node._parameter_overrides.get(leaf.name)
    value = leaf.default if given is None else given.value
    is_whole_number = leaf.type is float and isinstance(value, int) and not isinstance(value, bool)
    return float(value) if is_whole_number else value


def _descriptor(leaf: Leaf) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=leaf.meaning(), additional_constraints=leaf.range_text())
    if leaf.low is None and leaf.high is None:
        return descriptor
    if leaf.type is float:
        low, high = (-math.inf if leaf.low is None else leaf.low), (math.inf if leaf.high is None else leaf.high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
    elif leaf.type is int:
        low, high = (-MAX_INTEGER if leaf.low is None else leaf.low), (MAX_INTEGER if leaf.high is None else leaf.high)
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return descriptor
