"""Compile the kernels of both kinds of rigs before the first image waits for them."""

from __future__ import annotations

from functools import cache

import numpy as np

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Fisheye, Rig, RigCamera
from sphere_nav.params import build
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

SIDE = 32  # px of an image


@cache
def warm_up() -> None:
    """Stitch an instant of two cameras, side by side and one above the other, with depth, a cloud and in colour."""
    lens, params = Fisheye(SIDE, SIDE, 10.0, 10.0, 15.5, 15.5), build(StitchParams, {"width": 64})
    rng = np.random.default_rng(0)
    depth, points = np.ones((SIDE, SIDE), np.float32), rng.uniform(1.0, 3.0, (8, 3))
    for axis, levels in ((1, ("", "")), (2, ("top", "bottom"))):
        poses = [SE3.from_parts(T_BODY_OPTICAL.rotation, sign * 0.1 * np.eye(3)[axis]) for sign in (1.0, -1.0)]
        parts = [RigCamera(f"camera{k}", lens, T, level=levels[k]) for k, T in enumerate(poses)]
        stitcher = Stitcher(Rig(tuple(parts)), params)
        for shape in ((SIDE, SIDE), (SIDE, SIDE, 3)):
            images = {part.name: rng.integers(0, 255, shape, np.uint8) for part in parts}
            stitcher.stitch(images, points_rig=points, depths={parts[0].name: depth})
    DepthRegistration(lens, lens, SE3.identity())(depth)
