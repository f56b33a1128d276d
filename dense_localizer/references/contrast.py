"""Images whose local contrast is made equal: what the start compares, in whatever light.

Where the sky is bright and the street in shade, grey levels resemble those of any other street in the same light more
than those of this one in another light. Each pixel less the mean around it, by the deviation there (as N17 alg. 1 does
with depth), leaves where edges are.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import CONTRAST_FLOOR, CONTRAST_SCALE, CONTRAST_WINDOW_DEG, NUM_COARSE_LEVELS
from sphere_nav.geometry import Camera
from sphere_nav.photometric import Pyramid, build_pyramid
from sphere_nav.photometric.params import PyramidParams
from sphere_nav.photometric.pixels.pyramid import Image, pad_of


def equalize_contrast(image: Image, camera: Camera) -> NDArray[np.float32]:
    """Return an image (H, W) of mean 128 and deviation CONTRAST_SCALE around every pixel, less where little is seen."""
    side = 2 * round(0.5 * np.radians(CONTRAST_WINDOW_DEG) * camera.pixels_per_radian) + 1
    margin = min(side // 2 + 1, camera.width)
    gray = np.asarray(image, np.float32)
    if pad_of(camera):  # it closes
        gray = np.concatenate([gray[:, -margin:], gray, gray[:, :margin]], axis=1)
    mean, of_squares = (cv2.blur(part, (side, side), borderType=cv2.BORDER_REPLICATE) for part in (gray, gray * gray))
    deviation = np.sqrt(np.maximum(of_squares - mean * mean, 0.0) + np.float32(CONTRAST_FLOOR**2))
    equal = np.clip(128.0 + CONTRAST_SCALE * (gray - mean) / deviation, 0.0, 255.0).astype(np.float32)
    return np.ascontiguousarray(equal[:, margin:-margin] if pad_of(camera) else equal)


def equalize_pyramid(pyramid: Pyramid) -> Pyramid:
    """Return the coarsest levels of a pyramid, their contrast made equal."""
    first = max(0, len(pyramid.levels) - NUM_COARSE_LEVELS)
    camera = pyramid.cameras[first]
    params = PyramidParams(num_levels=len(pyramid.levels) - first, min_side=8)
    return build_pyramid(equalize_contrast(pyramid.images[first], camera), camera, params)
