"""A composition as a description for `ros2 launch`; imported by the launch files alone."""

from __future__ import annotations

from typing import Any

from launch import LaunchDescription  # type: ignore[attr-defined]  # the folder of that name lies beside
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from sphere_nav.ros.compositions import COMPOSITIONS, NodeStart


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
        return [_node(item) for item in composition.starts(given)]

    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def _node(item: NodeStart) -> Any:
    return Node(
        package="sphere_nav",
        executable=item.node,
        output="screen",
        namespace=item.namespace,
        parameters=[*([item.site] if item.site else []), dict(item.parameters)],
        remappings=list(item.topics.items()),
    )
