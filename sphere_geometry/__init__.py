"""Where things are: rigid motions and camera models. No images, no optimisation.

READ FIRST `se3.py` (SO(3), SE(3)), then `camera.py` (what every camera model offers) and one file per model:
`pinhole.py`, `fisheye.py`, `spherical.py`.
"""

from sphere_geometry.camera import Camera
from sphere_geometry.fisheye import Fisheye
from sphere_geometry.pinhole import Pinhole
from sphere_geometry.se3 import SE3
from sphere_geometry.spherical import Spherical

__all__ = ["SE3", "Camera", "Fisheye", "Pinhole", "Spherical"]
