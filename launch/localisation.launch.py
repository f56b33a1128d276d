"""The localiser in a map; with `drive:=true` also the path follower, which moves only after the call `start`.

ros2 launch sphere_nav localisation.launch.py map:=$HOME/maps/campus image:=/front/image_raw info:=/front/camera_info
ros2 service call /path_follower/start std_srvs/srv/Trigger
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CONFIG = [FindPackageShare("sphere_nav"), "config"]
ARGUMENTS = {
    "map": (None, "map to localise in"),
    "image": ("image_raw", "topic of the camera's images"),
    "info": ("camera_info", "topic of the camera's calibration"),
    "drive": ("false", "start the path follower too"),
    "trajectory": ("", "file of the trajectory to follow"),
    "stamped_cmd_vel": ("false", "cmd_vel is TwistStamped, not Twist"),
    "use_sim_time": ("false", "take the time from /clock"),
    "localizer_params": (PathJoinSubstitution([*CONFIG, "dense_localizer.yaml"]), "parameter file of the localiser"),
    "follower_params": (PathJoinSubstitution([*CONFIG, "path_follower.yaml"]), "parameter file of the path follower"),
}


def typed(name, kind):
    """Return an argument as a parameter of this type, whatever its text looks like."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def generate_launch_description():
    """Return what to start."""
    values = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    localizer = Node(
        package="sphere_nav",
        executable="dense_localizer",
        output="screen",
        parameters=[
            values["localizer_params"],
            {"map": typed("map", str), "use_sim_time": typed("use_sim_time", bool)},
        ],
        remappings=[
            ("image_raw", values["image"]),
            ("image_raw/compressed", [values["image"], "/compressed"]),
            ("camera_info", values["info"]),
        ],
    )
    follower = Node(
        package="sphere_nav",
        executable="path_follower",
        output="screen",
        condition=IfCondition(values["drive"]),
        parameters=[
            values["follower_params"],
            {
                "trajectory": typed("trajectory", str),
                "enable_stamped_cmd_vel": typed("stamped_cmd_vel", bool),
                "use_sim_time": typed("use_sim_time", bool),
            },
        ],
    )
    declared = [DeclareLaunchArgument(n, default_value=d, description=t) for n, (d, t) in ARGUMENTS.items()]
    return LaunchDescription([*declared, localizer, follower])
