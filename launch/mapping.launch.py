"""The mapper on live topics or on a bag, with the stitcher before it where a rig is named; `save_map` writes the map.

ros2 launch sphere_nav mapping.launch.py rig:=rig.yaml
ros2 launch sphere_nav mapping.launch.py input:=rgbd bag:=drive
ros2 service call /save_map sphere_nav_msgs/srv/SaveMap "{path: campus}"
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CONFIG = [FindPackageShare("sphere_nav"), "config"]
LAST_TOPIC = {"sphere": "sphere", "rgbd": "depth/image_raw", "stereo": "right/image_raw"}
ARGUMENTS = {
    "input": ("sphere", "what is mapped: sphere, rgbd or stereo"),
    "rig": ("", "rig file of six cameras, whose images the stitcher makes spheres of; empty: no stitcher"),
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
        parameters=[
            values["params"],
            {"input": typed("input", str), "use_sim_time": typed("use_sim_time", bool)},
        ],
    )
    stitcher = Node(
        package="sphere_nav",
        executable="sphere_stitcher",
        output="screen",
        condition=IfCondition(NotEqualsSubstitution(values["rig"], "")),
        parameters=[{"rig": typed("rig", str), "use_sim_time": typed("use_sim_time", bool)}],
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
                "wait_for": PythonExpression([f"{LAST_TOPIC}['", values["input"], "']"]),
            }
        ],
    )
    allowed = {"input": list(LAST_TOPIC)}
    declared = [
        DeclareLaunchArgument(n, default_value=d, description=t, choices=allowed.get(n))
        for n, (d, t) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, stitcher, mapper, player])
