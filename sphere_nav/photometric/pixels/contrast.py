"""Grey levels -> local contrast, which light changes less: an image less its local mean, over its local deviation.

As N17 (alg. 1) does with depth. A lamp, a shadow or the sky that is brighter changes mean and deviation over some
degrees; what is left are edges and texture, as bright in one light as in another. The window is an angle, the same in
an image and in a sphere.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Camera
from sphere_nav.photometric.constants import (
    CONTRAST_ANGLE,
    CONTRAST_FLOOR,
    CONTRAST_MEAN,
    CONTRAST_PIXELS,
    CONTRAST_SCALE,
    CONTRAST_STEPS,
)
from sphere_nav.photometric.pixels.pyramid import pad_of


def contrast_window(camera: Camera) -> float:
    """Return the standard deviation in rad of the window for images that are compared with those of a camera."""
    return max(CONTRAST_ANGLE, CONTRAST_PIXELS / float(camera.pixels_per_radian))


def local_contrast(
    image: NDArray[np.uint8] | NDArray[np.float32], camera: Camera, window_rad: float
) -> NDArray[np.uint8]:
    """Return the local contrast of a grey image (H, W) as bytes, `CONTRAST_MEAN` where there is none.

    Mean and deviation are those of a Gaussian window, found on blocks of pixels. `CONTRAST_FLOOR` is added to the
    deviation, so that noise is not made texture.
    """
    sigma = max(window_rad * float(camera.pixels_per_radian), 1.0)
    block = max(1, int(sigma / CONTRAST_STEPS))
    height, width = image.shape
    around = pad_of(camera) * min(int(np.ceil(4.0 * sigma / block)) * block, width)
    gray = image.astype(np.float32)
    wide = np.concatenate([gray[:, width - around :], gray, gray[:, :around]], axis=1) if around else gray
    small = (-(-wide.shape[1] // block), -(-height // block))
    mean = _smooth(cv2.resize(wide, small, interpolation=cv2.INTER_AREA), sigma / block)
    square = _smooth(cv2.resize(wide * wide, small, interpolation=cv2.INTER_AREA), sigma / block)
    gain = CONTRAST_SCALE / (np.sqrt(np.maximum(square - mean * mean, 0.0)) + np.float32(CONTRAST_FLOOR))
    size = wide.shape[1], height
    mean, gain = (cv2.resize(one, size, interpolation=cv2.INTER_LINEAR) for one in (mean, gain))
    inside = slice(around, around + width)
    contrast = (gray - mean[:, inside]) * gain[:, inside] + np.float32(CONTRAST_MEAN)
    return np.clip(np.rint(contrast), 1, 255).astype(np.uint8)


def _smooth(values: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101), np.float32)
