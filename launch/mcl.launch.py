"""The localiser in bare geometry.

ros2 launch sphere_nav mcl.launch.py cloud:=$HOME/maps/town.ply image:=/front/image_raw info:=/front/camera_info

The arguments: `ros2 launch sphere_nav mcl.launch.py -s`; without `ros2 launch`: `sphere_nav up mcl`.
"""

from sphere_nav.ros.launching import launch_description


def generate_launch_description():
    """Return what to start."""
    return launch_description("mcl")
