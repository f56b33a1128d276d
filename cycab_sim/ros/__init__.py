"""The ROS shell of the simulator."""
