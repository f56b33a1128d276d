"""The localiser in bare geometry.

ros2 launch sphere_nav mcl.launch.py cloud:=$HOME/maps/town.ply image:=/front/image_raw info:=/front/camera_info
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "cloud": (None, "cloud, mesh, floor plan or map to localise in"),
    "image": ("image_raw", "topic of the camera's images"),
    "info": ("camera_info", "topic of the camera's calibration"),
    "odom": ("odom", "topic of the odometry"),
    "namespace": ("", "of the node, where another localiser runs beside it"),
    "other": ("other/pose", "topic of the pose of another localiser, which watches and helps"),
    "path": ("reference_path", "topic of the path to be followed by direction"),
    "preset": ("auto", "surroundings: indoor, outdoor, or auto: by the cloud"),
    "use_sim_time": ("false", "take the time from /clock"),
    "params": (PathJoinSubstitution([FindPackageShare("sphere_nav"), "config", "mcl_depth.yaml"]), "parameter file"),
}


def typed(name, kind):
    """Return an argument as a parameter of this type, whatever its text looks like."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def generate_launch_description():
    """Return what to start."""
    values = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    node = Node(
        package="sphere_nav",
        executable="mcl_depth",
        output="screen",
        parameters=[
            values["params"],
            {"cloud": typed("cloud", str), "preset": typed("preset", str)},
            {"use_sim_time": typed("use_sim_time", bool)},
        ],
        namespace=values["namespace"],
        remappings=[
            ("image_raw", values["image"]),
            ("camera_info", values["info"]),
            ("odom", values["odom"]),
            ("other/pose", values["other"]),
            ("reference_path", values["path"]),
        ],
    )
    declared = [DeclareLaunchArgument(n, default_value=d, description=t) for n, (d, t) in ARGUMENTS.items()]
    return LaunchDescription([*declared, node])
