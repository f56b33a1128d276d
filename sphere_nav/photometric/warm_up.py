"""Compile every kernel before the first image, on images too small to cost anything."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.photometric.align.esm import correlation_after_turn, register, register_rig, register_rotation
from sphere_nav.photometric.align.problem import MAX_VIEWS, RigImage
from sphere_nav.photometric.checks.structure import find_rig_structure
from sphere_nav.photometric.params import PyramidParams, RegistrationParams
from sphere_nav.photometric.pixels.pyramid import build_pyramid
from sphere_nav.photometric.pixels.reference import View, prepare_reference

CAMERA = Spherical(128, 64)
NUM_PIXELS = 4096  # half of them, so that some are chosen, and enough for two pieces of an image


@cache
def warm_up() -> None:
    """Run the whole registration once, for both kinds of image; some seconds, or nothing where the cache has it."""
    params = RegistrationParams(pyramid=PyramidParams(num_levels=2, min_side=8), max_pixels=NUM_PIXELS)
    image = np.random.default_rng(0).integers(0, 255, (CAMERA.height, CAMERA.width)).astype(np.uint8)
    range_m = np.full(image.shape, 5.0, np.float32)
    for one in (image, image.astype(np.float32)):
        view = View(prepare_reference(one, range_m, CAMERA, params), SE3.identity())
        pyramid = build_pyramid(one, CAMERA, params.pyramid)
        register(pyramid, [view], SE3.identity(), params)
        register_rotation(pyramid, pyramid, params)
        correlation_after_turn(pyramid, pyramid, np.eye(3))
        images = [RigImage(pyramid, SE3.identity(), (view,))]
        register_rig((MAX_VIEWS + 1) * images, SE3.identity(), params)
        found = register_rig(images, SE3.identity(), params)
        for turn in (0.0, 1.0):  # turned away, its parts are asked, too
            there = replace(found, T_world_camera=SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, turn]))
            find_rig_structure(images, there, params)
