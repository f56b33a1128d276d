"""Beside Nav2: map -> odom for its costmaps, commands to its collision monitor. See docs/launch.md.

ros2 launch sphere_nav nav2.launch.py map:=$HOME/maps/campus trajectory:=$HOME/maps/campus.tum odom:=/odom

The arguments: `ros2 launch sphere_nav nav2.launch.py -s`; without `ros2 launch`: `sphere_nav up nav2`.
"""

from sphere_nav.ros.launching import launch_description


def generate_launch_description():
    """Return what to start."""
    return launch_description("nav2")
