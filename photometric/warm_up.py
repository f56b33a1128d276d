"""Compile every kernel before the first image, on images too small to cost anything."""

from __future__ import annotations

from functools import cache

import numpy as np

from photometric.esm import register
from photometric.params import PyramidParams, RegistrationParams
from photometric.pyramid import build_pyramid
from photometric.reference import View, prepare_reference
from photometric.rig import RigImage, register_rig
from photometric.rotation import correlation_after_turn, register_rotation
from photometric.structure import find_rig_structure
from sphere_geometry import SE3, Spherical

CAMERA = Spherical(64, 32)


@cache
def warm_up() -> None:
    """Run the whole registration once, for both kinds of image; some seconds, or nothing where the cache has it."""
    params = RegistrationParams(pyramid=PyramidParams(num_levels=2, min_side=8))
    image = np.random.default_rng(0).integers(0, 255, (32, 64)).astype(np.uint8)
    range_m = np.full(image.shape, 5.0, np.float32)
    for one in (image, image.astype(np.float32)):
        view = View(prepare_reference(one, range_m, CAMERA, params), SE3.identity())
        pyramid = build_pyramid(one, CAMERA, params.pyramid)
        register(pyramid, [view], SE3.identity(), params)
        register_rotation(pyramid, pyramid, params)
        correlation_after_turn(pyramid.levels[0], pyramid.levels[0], np.eye(3))
        images = [RigImage(pyramid, SE3.identity(), (view,))]
        find_rig_structure(images, register_rig(images, SE3.identity(), params), params)
