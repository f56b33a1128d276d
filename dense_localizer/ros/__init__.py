"""The ROS shell of dense_localizer."""
