"""Where things are: rigid motions and camera models. No images, no optimisation.

READ FIRST `se3.py` (SO(3), SE(3)), then `cameras/camera.py` (what every camera model offers) and the models
beside it; `cameras/rolling_shutter.py` is the rolling shutter, `cameras/rig.py` several cameras, `files/` how they are
written.
"""

from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere, Omni
from sphere_nav.geometry.cameras.pinhole import Fisheye, Pinhole
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav.geometry.cameras.rolling_shutter import FrameMotion
from sphere_nav.geometry.cameras.spherical import Spherical
from sphere_nav.geometry.se3 import SE3

__all__ = [
    "SE3",
    "Camera",
    "DoubleSphere",
    "Fisheye",
    "FrameMotion",
    "Omni",
    "Pinhole",
    "Rig",
    "RigCamera",
    "Spherical",
]
