"""The localiser in a map.

ros2 launch sphere_nav localisation.launch.py map:=$HOME/maps/campus image:=/front/image_raw info:=/front/camera_info

The arguments: `ros2 launch sphere_nav localisation.launch.py -s`; without `ros2 launch`: `sphere_nav up localisation`.
"""

from sphere_nav.ros.launching import launch_description


def generate_launch_description():
    """Return what to start."""
    return launch_description("localisation")
