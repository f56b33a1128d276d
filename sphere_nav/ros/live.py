"""rclpy beneath a ManagedNode: its lifecycle, its parameters, and in words what the node waits for."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from sphere_nav.params import Leaf, leaves, meant, param, parameters
from sphere_nav.ros.constants import LOG_PERIOD_S
from sphere_nav.ros.endpoints import OK, WARN, Entry
from sphere_nav.ros.executor import CallbackFailures
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.rclpy_shell import RclpyShell
from sphere_nav.ros.service import one_line
from sphere_nav.ros.site_file import check_rules

SUBJECTS = ("map", "cloud", "trajectory", "network", "rig", "input", "bag", "world", "output")  # what a node works on
KINDS: dict[type[Any], tuple[str, type[Any], float]] = {  # ranges in a descriptor, and the largest number
    float: ("floating_point_range", FloatingPointRange, math.inf),
    int: ("integer_range", IntegerRange, 2**63 - 1),
}
CLOCK_CHOICE = "use_sim_time"  # of rclpy; silence is judged by that clock
Transition = Callable[["LiveShell", LifecycleState], TransitionCallbackReturn]


@parameters
class ShellParams:
    """What every live node has besides its own parameters."""

    autostart: bool = param(True, "configure and activate at once instead of waiting for a lifecycle manager")


def _logged(transition: Transition) -> Transition:
    """Log what a transition raises, which rclpy would not: an error leads to `on_error`."""

    @wraps(transition)
    def attempt(shell: LiveShell, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            return transition(shell, state)
        except Exception:
            shell.log.error(traceback.format_exc().rstrip())
            return TransitionCallbackReturn.ERROR

    return attempt


class LiveShell(RclpyShell, LifecycleNode):
    """A lifecycle node that carries out what its ManagedNode asks for."""

    def __init__(self, node_class: type[ManagedNode], words: Sequence[str] = (), **options: Any) -> None:
        """`words`: of the command line; ValueError for a parameter or a name in it that cannot be."""
        super().__init__(node_class.NAME, enable_logger_service=True, **options)
        self.is_configured = False
        answer_wrong_types(self, self.failures)
        declare(self, self._why_fixed, ShellParams, node_class.PARAMS)
        self.add_post_set_parameters_callback(self._tune)
        self.node = node_class(self)
        called = node_class.NAME, self.get_name(), self.get_namespace()
        for line in [*unknown_overrides(self), *check_rules(words, *called, self.driver_topics)]:
            self.log.warning(line)

    def start(self) -> bool:
        """Configure and activate if `autostart` says so; whether the node is where it should be."""
        if not self.get_parameter("autostart").value:
            return True
        done = TransitionCallbackReturn.SUCCESS
        return self.trigger_configure() == done and self.trigger_activate() == done

    def stop(self) -> None:
        """Bring the node down in order, whatever its state; used before the process ends."""
        if self.is_active:
            self.trigger_deactivate()
        if self.is_configured:
            self.trigger_cleanup()

    # --- transitions
    @_logged
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured to inactive; a ValueError or OSError of the node is one line in the log."""
        try:
            self.node.params = self.read_parameters(self.node.PARAMS)
            self.node.configure()
        except (ValueError, OSError) as error:
            self.log.error(f"cannot start: {one_line(error)}")
            self._release()
            return TransitionCallbackReturn.FAILURE
        self.is_configured = True
        return TransitionCallbackReturn.SUCCESS

    @_logged
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive to active; what was latched meanwhile is delivered."""
        self.is_active = True
        self.node.activate()
        self.deliver_kept()
        return TransitionCallbackReturn.SUCCESS

    @_logged
    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active to inactive."""
        try:
            self.node.deactivate()
        finally:
            self.is_active = False
        return TransitionCallbackReturn.SUCCESS

    @_logged
    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive to unconfigured."""
        self.is_configured = False
        try:
            self.node.cleanup()
        finally:
            self._release()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Whatever to finalized."""
        if self.is_active:
            self.on_deactivate(state)
        return self.on_cleanup(state) if self.is_configured else TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After a failed transition: back to unconfigured."""
        self.is_active = self.is_configured = False
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def _tune(self, changes: list[Parameter]) -> None:
        """Hand on live parameters that were changed; the others are read when the node is configured."""
        live = {leaf.name for leaf in leaves(self.node.PARAMS) if leaf.is_live} if self.is_configured else set()
        if any(change.name in live for change in changes):
            self.node.tune(self.read_parameters(self.node.PARAMS))

    # --- health
    def _why_fixed(self) -> str:
        return "fixed while the node is configured; clean the node up first, or set it at start" * self.is_configured

    def clock_jumped(self) -> None:
        """Hand on that the clock went backwards."""
        if self.is_configured:
            self.node.clock_jumped()

    def _subject(self) -> str:
        named = ((name, getattr(self.node.params, name, "")) for name in SUBJECTS)
        return ", ".join(f"{name} {value}" for name, value in named if value and isinstance(value, str))

    def _lack(self) -> str:
        return self.node.lack()

    def _life(self) -> Iterable[tuple[str, Entry]]:
        label = self._state_machine.current_state[1]
        level, text = OK if self.is_active else WARN, label
        if self.is_time_simulated and self.now_ns() == 0:
            level, text = WARN, "waiting for /clock (use_sim_time is true): no time yet"
            self.log.warning(text, every=LOG_PERIOD_S)
        return [("lifecycle", (level, text, {"state": label}))]


# --- a parameters class (sphere_nav.params) as declared ROS parameters, and back
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
