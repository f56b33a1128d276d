"""The simulated Cycab; with `map` also the localiser and the path follower, so that it drives by its camera.

ros2 launch sphere_nav simulation.launch.py mode:=teach record:=drive
ros2 launch sphere_nav simulation.launch.py map:=town trajectory:=taught.tum

The arguments: `ros2 launch sphere_nav simulation.launch.py -s`; without `ros2 launch`: `sphere_nav up simulation`.
"""

from sphere_nav.ros.launching import launch_description


def generate_launch_description():
    """Return what to start."""
    return launch_description("simulation")
