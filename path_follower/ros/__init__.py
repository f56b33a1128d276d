"""The ROS shells of path_follower and command_guard."""
