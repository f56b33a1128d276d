"""Images of one camera or a rig as nodes receive them: streams, drivers, mountings, odometry."""
