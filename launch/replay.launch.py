"""A recorded drive, localised in a map.

ros2 launch sphere_nav replay.launch.py map:=$HOME/maps/campus bag:=drive

The arguments: `ros2 launch sphere_nav replay.launch.py -s`; without `ros2 launch`: `sphere_nav up replay`.
"""

from sphere_nav.ros.launching import launch_description


def generate_launch_description():
    """Return what to start."""
    return launch_description("replay")
