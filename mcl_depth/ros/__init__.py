"""The ROS shell of mcl_depth."""
