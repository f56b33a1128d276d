"""A photograph of any camera, however it leans, resampled into the level panorama (N17 section V)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_geometry import Camera, Spherical
from sphere_geometry.camera import pixel_grid

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
SAMPLES = 2  # a side of a pixel of the panorama
SHRINK = 2.0  # photographs this many times finer than the panorama are halved first


def level_view(
    image: NDArray[np.generic], camera: Camera, rotation: NDArray[np.float64], target: Spherical
) -> tuple[Image, Mask]:
    """Return the panorama (H, W) float32 that the camera saw of `target`, and which of its pixels it saw.

    image: (h, w) or (h, w, 3) RGB. rotation: R_level_camera (3, 3), from the camera's axes to level body axes (x along
    the heading, z up).
    """
    if image.shape[:2] != (camera.height, camera.width):
        raise ValueError(f"image: expected {camera.width} x {camera.height}, found {image.shape[1::-1]}")
    grey = _grey(image)
    while camera.pixels_per_radian > SHRINK * target.pixels_per_radian and not (grey.shape[0] % 2 or grey.shape[1] % 2):
        grey = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
        camera = camera.halved()
    grid = pixel_grid(target)
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    total = np.zeros(grid.shape[:2], np.float32)
    is_seen = np.ones(grid.shape[:2], np.bool_)
    around = isinstance(camera, Spherical) and camera.width == camera.full_width
    if around:  # one more column on either side, so that the seam is interpolated
        grey = np.hstack([grey[:, -1:], grey, grey[:, :1]])
    for du in offsets:
        for dv in offsets:
            pixels, is_inside = camera.project(target.unproject(grid + np.array([du, dv])) @ rotation)
            maps = np.nan_to_num(pixels, nan=-1e4).astype(np.float32) + np.array(
                [1.0 if around else 0.0, 0.0], np.float32
            )
            sample = cv2.remap(grey, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            total += sample
            is_seen &= is_inside & np.all(np.isfinite(pixels), axis=-1)
    return np.where(is_seen, total / SAMPLES**2, np.float32(0.0)).astype(np.float32), is_seen


def _grey(image: NDArray[np.generic]) -> Image:
    if image.ndim == 3:
        return (image[..., :3].astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)).astype(np.float32)
    return np.ascontiguousarray(image, np.float32)
