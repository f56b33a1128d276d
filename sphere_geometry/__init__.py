"""Where things are: rigid motions and camera models. No images, no optimisation.

READ FIRST `se3.py` (SO(3), SE(3)), then `camera.py` (what every camera model offers) and one file per model:
`pinhole.py`, `fisheye.py`, `double_sphere.py`, `spherical.py`; `shutter.py` is the rolling shutter. `rig.py` is several
cameras, `rig_file.py` its file.
"""

from sphere_geometry.camera import Camera
from sphere_geometry.double_sphere import DoubleSphere
from sphere_geometry.fisheye import Fisheye
from sphere_geometry.pinhole import Pinhole
from sphere_geometry.rig import Rig, RigCamera
from sphere_geometry.se3 import SE3
from sphere_geometry.shutter import FrameMotion
from sphere_geometry.spherical import Spherical

__all__ = ["SE3", "Camera", "DoubleSphere", "Fisheye", "FrameMotion", "Pinhole", "Rig", "RigCamera", "Spherical"]
