"""A photograph of any camera, however it leans, resampled into the level panorama (N17 section V)."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import SAMPLES
from sphere_nav.geometry import Camera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


def level_view(
    image: NDArray[np.generic], camera: Camera, rotation: NDArray[np.float64], target: Spherical
) -> tuple[Image, Mask]:
    """Return the panorama (H, W) float32 that the camera saw of `target`, and which of its pixels it saw.

    image: grey (h, w). rotation: R_level_camera (3, 3), from the camera's axes to level body axes (x along the heading,
    z up).
    """
    gray = np.ascontiguousarray(image, np.float32)
    finest = SAMPLES * target.pixels_per_radian
    while camera.pixels_per_radian > finest and not (gray.shape[0] % 2 or gray.shape[1] % 2):
        gray = cv2.resize(gray, (gray.shape[1] // 2, gray.shape[0] // 2), interpolation=cv2.INTER_AREA)
        camera = camera.halve()
    u, v, is_seen = _maps(camera, np.asarray(rotation, np.float64).tobytes(), target)
    if isinstance(camera, Spherical) and camera.width == camera.full_width:
        gray, u = np.hstack([gray[:, -1:], gray, gray[:, :1]]), u + np.float32(1.0)  # so that the seam is interpolated
    drawn = cv2.remap(gray, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    found = cv2.resize(drawn, (target.width, target.height), interpolation=cv2.INTER_AREA)
    return np.where(is_seen, found, np.float32(0.0)), is_seen.copy()


@lru_cache(maxsize=4)
def _maps(camera: Camera, rotation: bytes, target: Spherical) -> tuple[Image, Image, Mask]:
    """Return where the samples of the panorama lie in the image, and which pixels (H, W) have all samples in it.

    The same for every image of a camera that does not lean.
    """
    names = ("width", "height", "full_width", "offset_u", "offset_v")
    finer = replace(target, **{name: SAMPLES * getattr(target, name) for name in names})
    pixels, is_inside = camera.project(pixel_rays(finer) @ np.frombuffer(rotation).reshape(3, 3))
    is_seen = is_inside & np.all(np.isfinite(pixels), axis=-1)
    u, v = np.ascontiguousarray(np.moveaxis(np.nan_to_num(pixels, nan=-1e4), -1, 0), np.float32)
    return u, v, is_seen.reshape(target.height, SAMPLES, target.width, SAMPLES).all(axis=(1, 3))
