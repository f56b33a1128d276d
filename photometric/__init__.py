"""Image against image: dense, photometric, direct (M15 sections 2, 3.6, 5.2, 9).

READ FIRST `esm.py`. `prepare_reference` makes an augmented image ready once, `build_pyramid` the current one each
time, `register` aligns them.
"""

from photometric.alignment import Alignment
from photometric.esm import evaluate, register
from photometric.params import PyramidParams, RegistrationParams
from photometric.pyramid import Pyramid, build_pyramid
from photometric.reference import Reference, View, prepare_reference
from photometric.rotation import register_rotation
from photometric.warm_up import warm_up

__all__ = [
    "Alignment",
    "Pyramid",
    "PyramidParams",
    "Reference",
    "RegistrationParams",
    "View",
    "build_pyramid",
    "evaluate",
    "prepare_reference",
    "register",
    "register_rotation",
    "warm_up",
]
