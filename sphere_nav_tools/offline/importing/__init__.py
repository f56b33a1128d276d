"""Recorded data sets as our messages, a file for each kind; `import_.py` is the command.

Conventions. `ground_truth/pose` is T_map_camera_link: the body axes (x forward, y left, z up) of the camera that made
`image_raw`, of the left camera of a pair, or of the sphere; base_link coincides with it. Optical frames hang below in
`/tf_static`. Data sets whose world has the axes of a camera (y down) are turned so that z of the map points up.
"""
