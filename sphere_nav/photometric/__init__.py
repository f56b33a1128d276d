"""Image against image: dense, photometric, direct (M15 sections 2, 3.6, 5.2, 9).

READ FIRST `esm.py`. `prepare_reference` makes an augmented image ready once, `build_pyramid` the current one each
time, `register` aligns them, and `register_rig` the images of several cameras.
"""

from sphere_nav.photometric.align.esm import Alignment, evaluate, register, register_rig, register_rotation
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.params import PyramidParams, RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Pyramid, build_pyramid
from sphere_nav.photometric.pixels.reference import Reference, View, prepare_reference
from sphere_nav.photometric.warm_up import warm_up

__all__ = [
    "Alignment",
    "Pyramid",
    "PyramidParams",
    "Reference",
    "RegistrationParams",
    "RigImage",
    "View",
    "build_pyramid",
    "evaluate",
    "prepare_reference",
    "register",
    "register_rig",
    "register_rotation",
    "warm_up",
]
