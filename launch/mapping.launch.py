"""The mapper on spheres as they come, or from a bag; `ros2 service call /save_map` writes the map.

ros2 launch sphere_nav mapping.launch.py
ros2 launch sphere_nav mapping.launch.py bag:=drive
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CONFIG = [FindPackageShare("sphere_nav"), "config"]
ARGUMENTS = {
    "bag": ("", "bag to play; empty: live topics"),
    "rate": ("1.0", "speed of playing; 0: as fast as the mapper takes it"),
    "use_sim_time": ("false", "take the time from /clock"),
    "params": (PathJoinSubstitution([*CONFIG, "sphere_mapper.yaml"]), "parameter file of the mapper"),
}


def typed(name, kind):
    """Return an argument as a parameter of this type, whatever its text looks like."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def generate_launch_description():
    """Return what to start."""
    values = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    mapper = Node(
        package="sphere_nav",
        executable="sphere_mapper",
        output="screen",
        parameters=[values["params"], {"use_sim_time": typed("use_sim_time", bool)}],
    )
    player = Node(
        package="sphere_nav",
        executable="bag_player",
        output="screen",
        condition=IfCondition(NotEqualsSubstitution(values["bag"], "")),
        parameters=[
            {
                "bag": typed("bag", str),
                "rate": typed("rate", float),
                "wait_for": "sphere",
            }
        ],
    )
    declared = [DeclareLaunchArgument(n, default_value=d, description=t) for n, (d, t) in ARGUMENTS.items()]
    return LaunchDescription([*declared, mapper, player])
