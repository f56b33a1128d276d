"""The localiser and the path follower, which moves only after the call `start`.

ros2 launch sphere_nav navigation.launch.py map:=$HOME/maps/campus trajectory:=$HOME/maps/campus.tum
ros2 service call /path_follower/start std_srvs/srv/Trigger

The arguments: `ros2 launch sphere_nav navigation.launch.py -s`; without `ros2 launch`: `sphere_nav up navigation`.
"""

from sphere_nav.ros.launching import launch_description


def generate_launch_description():
    """Return what to start."""
    return launch_description("navigation")
