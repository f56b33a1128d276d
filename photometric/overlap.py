"""How much of an image the references cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photometric.problem import level_like, visible
from photometric.pyramid import Pyramid
from photometric.reference import View
from sphere_geometry import SE3


def image_overlap(pyramid: Pyramid, views: Sequence[View], T_world_camera: SE3) -> float:
    """Return the share (0..1) of the image's area that the best covering reference covers with range.

    Counted at the coarsest level, pixels of the reference scaled to pixels of the image.
    """
    level = pyramid.levels[-1]
    area = level.camera.width * level.camera.height
    best = 0.0
    for view in views:
        pixels = level_like(view.reference, level)
        seen = visible(pixels, T_world_camera.inverse() @ view.T_world_reference, level)
        scale = level.camera.pixels_per_radian / pixels.camera.pixels_per_radian
        best = max(best, float(np.count_nonzero(seen)) * scale**2 / area)
    return min(best, 1.0)
