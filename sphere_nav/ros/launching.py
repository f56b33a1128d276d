"""A composition as a description for `ros2 launch`; imported by the launch files alone."""

from __future__ import annotations

import shutil
from functools import partial
from typing import Any

from launch import LaunchDescription  # type: ignore[attr-defined]  # the folder of that name lies beside
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from sphere_nav.ros.compositions import COMPOSITIONS, RESTART_AFTER, Composition, NodeStart, after_exit
from sphere_nav.ros.constants import END_PATIENCE_S

PREFIX = "launch-prefix"
OF_LAUNCH = {PREFIX, "launch-prefix-filter", "emulate_tty", "sigterm_timeout", "sigkill_timeout"}


def launch_description(name: str) -> Any:
    """Return what to start; the arguments are those of `sphere_nav up NAME`."""
    composition = COMPOSITIONS[name]
    declared = [
        DeclareLaunchArgument(
            key, default_value=argument.default, description=argument.meaning, choices=argument.choices or None
        )
        for key, argument in composition.arguments.items()
    ]

    def start(context: Any) -> list[Any]:
        given = {key: LaunchConfiguration(key).perform(context) for key in composition.arguments}
        prefix = None if PREFIX in context.launch_configurations else _with_parent()
        return [_node(item, prefix) for item in composition.ready(given)]

    return LaunchDescription(
        [OpaqueFunction(function=partial(_check, composition)), *declared, OpaqueFunction(function=start)]
    )


def _check(composition: Composition, context: Any) -> None:
    """Refuse arguments of the command line that are unknown or impossible; `launch` itself takes any name.

    Before an argument is declared, there is what was typed, and nothing else, unless another launch file includes this
    one. Then a name may be that file's own.
    """
    given = {key: value for key, value in context.launch_configurations.items() if key not in OF_LAUNCH}
    typed = dict(word.split(":=", 1) for word in context.argv if ":=" in word)
    if given == {key: value for key, value in typed.items() if key not in OF_LAUNCH}:
        composition.ready(given)


def _with_parent() -> str | None:
    """Return what, before a command, lets the kernel end a node when `ros2 launch` is killed or terminated.

    Neither is handed on by `launch`: a follower would drive on without it. None where there is no `setpriv` (Linux).
    """
    return "setpriv --pdeathsig TERM" if shutil.which("setpriv") else None


def _node(item: NodeStart, prefix: str | None) -> Any:
    num_restarts = -1

    def ended(event: Any, context: Any) -> None:
        """Raise, which ends all with exit status 1 and one line, unless the node may end or starts again."""
        nonlocal num_restarts
        num_restarts += 1
        if not context.is_shutdown:
            after_exit(item.node, event.returncode, num_restarts)
        elif event.returncode > 0:
            raise RuntimeError(f"{item.node} ended with status {event.returncode}")

    return Node(
        package="sphere_nav",
        executable=item.node,
        exec_name=item.node,
        output="screen",
        namespace=item.namespace,
        parameters=[*([item.site] if item.site else []), dict(item.parameters)],
        remappings=list(item.topics.items()),
        ros_arguments=["--enclave", item.enclave] if item.enclave else None,
        prefix=prefix,
        sigterm_timeout=LaunchConfiguration("sigterm_timeout", default=str(END_PATIENCE_S)),
        respawn=RESTART_AFTER[item.node] is not None,
        respawn_delay=RESTART_AFTER[item.node],
        on_exit=ended,
    )
