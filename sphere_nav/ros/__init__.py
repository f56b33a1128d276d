"""Everything that is ROS and shared by the nodes.

READ FIRST `node.py`: a node is a `ManagedNode`, the same object live and in a replay. Then
`live.py` and `run.py` (rclpy beneath it), `bags/replay.py` (a recorded bag beneath it), `conversions/` (messages to
arrays and back), `bags/` and `maps/` (files), `tf.py`, `qos.py`.
"""
