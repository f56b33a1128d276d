"""Our registration under the face of `peers.Method`: depth of the reference, grey values of both."""

from __future__ import annotations

import numpy as np

from benchmarks.rgbd_data import Frame
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric import (
    PyramidParams,
    Reference,
    RegistrationParams,
    View,
    build_pyramid,
    prepare_reference,
    register,
)
from sphere_nav.photometric.align.problem import Problem

# Images of a Kinect are soft: half their size carries what can be aligned, and a tenth of a pixel is below their noise.
SOFT_IMAGES = RegistrationParams(pyramid=PyramidParams(finest=1), max_pixels=20_000, min_step=0.1)


class Ours:
    """One reference, started from no motion, exactly as the localiser calls it."""

    name = "sphere_nav"

    def __init__(self, camera: Pinhole, params: RegistrationParams | None = None) -> None:
        self.camera = camera
        self.params = params or SOFT_IMAGES
        self.range_by_depth = (1.0 / pixel_rays(camera)[..., 2]).astype(np.float32)

    def prepare(self, frame: Frame) -> Reference:
        """Turn depth into range along the ray, prepare all levels of the reference and choose its pixels."""
        params = self.params
        reference = prepare_reference(frame.gray, frame.depth_m * self.range_by_depth, self.camera, params)
        for level in build_pyramid(frame.gray, self.camera, params.pyramid).levels[params.pyramid.finest :]:
            Problem.choose_pixels(level, [View(reference, SE3.identity())], SE3.identity(), params)
        return reference

    def track(self, reference: Reference, frame: Frame) -> SE3 | None:
        """Build the pyramid of the current image and align it; its depth is not used."""
        pyramid = build_pyramid(frame.gray, self.camera, self.params.pyramid)
        alignment = register(pyramid, [View(reference, SE3.identity())], SE3.identity(), self.params)
        return alignment.T_world_camera
