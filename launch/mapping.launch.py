"""The mapper on live topics or on a bag, with the stitcher before it where a rig is named; `save_map` writes the map.

ros2 launch sphere_nav mapping.launch.py rig:=rig.yaml
ros2 launch sphere_nav mapping.launch.py input:=rgbd bag:=drive
ros2 service call /sphere_mapper/save_map sphere_nav_msgs/srv/SaveMap "{path: campus}"

The arguments: `ros2 launch sphere_nav mapping.launch.py -s`; without `ros2 launch`: `sphere_nav up mapping`.
"""

from sphere_nav.ros.launching import launch_description


def generate_launch_description():
    """Return what to start."""
    return launch_description("mapping")
