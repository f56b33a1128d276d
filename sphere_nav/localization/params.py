"""Parameters that both localisers have, by the same names."""

from __future__ import annotations

from sphere_nav.params import param, parameters


@parameters
class InputParams:
    """Which images are used (`input_check.py`)."""

    allow_still: bool = param(False, "identical images are no fault while standing still (noise-free simulation)")
    max_leap_s: float = param(10.0, "step between stamps that is taken for a fault", "s", low=0.1)
    timeout_s: float = param(0.5, "silence after which the pose is not current any more", "s", low=0.01)


@parameters
class StateParams:
    """When a pose is trusted (`status.py`)."""

    probation_images: int = param(4, "good images in a row before a pose is trusted; doubled by each loss", low=1)
    max_blind_s: float = param(0.5, "time without an image that confirms the pose until LOST", "s", low=0.0)


@parameters
class RigParams:
    """Several cameras that localise together (sphere_nav/ros/camera/intake.py)."""

    cameras: str = param(
        "", "several cameras, on cameras/<name>/image_raw: their names, with commas; empty: one camera"
    )
    calibration: str = param("", "rig file of lenses and poses, or map for that in the map; empty: by /tf_static")
    frame: str = param("rig_link", "frame of the rig in /tf_static, where mounting does not say where the rig is")
    slack: float = param(0.015, "stamps of one instant differ by less: less than half a period", "s", low=0.0, high=0.5)


@parameters
class NodeParams:
    """What the node of a localiser needs besides its algorithm (sphere_nav.ros)."""

    map_frame: str = param("map", "frame of the poses")
    base_frame: str = param("base_link", "frame whose pose is published")
    camera_frame: str = param("", "optical frame of the camera; empty: the frame_id of the images")
    mounting: str = param("", "camera on base_frame, x,y,z,roll,pitch,yaw (m, rad) or a YAML; empty: by /tf_static")
    driver: str = param("", "camera driver whose topics are heard: a name in config/cameras, or a file of that form")
    transport: str = param("raw", "images come on image_raw, or on image_raw/compressed", choices=("raw", "compressed"))
    is_rectified: bool = param(False, "images are rectified: use P of camera_info, as for topics named rect")
    is_panorama: bool = param(
        False, "images are whole spheres (equirectangular, twice as wide as high), not calibrated"
    )
    every_image: bool = param(
        False, "reliable and deep queues: a slow computer answers late but drops none, and answers the same"
    )
    publish_tf: bool = param(True, "publish map -> odom where anyone publishes odom -> base, else map -> base_frame")
