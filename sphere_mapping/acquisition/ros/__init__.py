"""The ROS shell of acquisition: images of a rig in, spheres out."""
