"""The ROS shell of sphere_mapper."""
