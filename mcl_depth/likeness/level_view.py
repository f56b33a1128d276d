"""A photograph of any camera, however it leans, resampled into the level panorama (N17 section V)."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import SAMPLES
from sphere_nav.geometry import Camera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


def level_view(
    image: NDArray[np.generic], camera: Camera, rotation: NDArray[np.float64], target: Spherical
) -> tuple[Image, Mask]:
    """Return the panorama (H, W) float32 that the camera saw of `target`, and which of its pixels it saw.

    image: (h, w) or (h, w, 3) RGB. rotation: R_level_camera (3, 3), from the camera's axes to level body axes (x along
    the heading, z up).
    """
    if image.shape[:2] != (camera.height, camera.width):
        raise ValueError(f"image: expected {camera.width} x {camera.height}, found {image.shape[1::-1]}")
    gray = _gray(image)
    finest = SAMPLES * target.pixels_per_radian
    while camera.pixels_per_radian > finest and not (gray.shape[0] % 2 or gray.shape[1] % 2):
        gray = cv2.resize(gray, (gray.shape[1] // 2, gray.shape[0] // 2), interpolation=cv2.INTER_AREA)
        camera = camera.halve()
    around = isinstance(camera, Spherical) and camera.width == camera.full_width
    if around:  # one more column on either side, so that the seam is interpolated
        gray = np.hstack([gray[:, -1:], gray, gray[:, :1]])
    maps, is_seen = _maps(camera, np.asarray(rotation, np.float64).tobytes(), target)
    total = np.zeros(is_seen.shape, np.float32)
    shift = np.float32(1.0 if around else 0.0)
    for u, v in maps:
        total += cv2.remap(gray, u + shift, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(is_seen, total / SAMPLES**2, np.float32(0.0)).astype(np.float32), is_seen.copy()


@lru_cache(maxsize=4)
def _maps(camera: Camera, rotation: bytes, target: Spherical) -> tuple[list[tuple[Image, Image]], Mask]:
    """Return where every sample of the panorama lies in the image, and which pixels (H, W) have all samples in it.

    The same for every image of a camera that does not lean.
    """
    R_level_camera = np.frombuffer(rotation).reshape(3, 3)
    is_seen = np.ones((target.height, target.width), np.bool_)
    maps = []
    for rays in _rays(target):
        pixels, is_inside = camera.project(rays @ R_level_camera)
        is_seen &= is_inside & np.all(np.isfinite(pixels), axis=-1)
        sample = np.nan_to_num(pixels, nan=-1e4).astype(np.float32)
        maps.append((np.ascontiguousarray(sample[..., 0]), np.ascontiguousarray(sample[..., 1])))
    return maps, is_seen


@lru_cache(maxsize=4)
def _rays(target: Spherical) -> list[NDArray[np.float64]]:
    """Return the rays (H, W, 3) of the samples of every pixel of a panorama."""
    grid, offsets = pixel_grid(target), (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    return [target.unproject(grid + np.array([du, dv])) for du in offsets for dv in offsets]


def _gray(image: NDArray[np.generic]) -> Image:
    if image.ndim == 3:
        return (image[..., :3].astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)).astype(np.float32)
    return np.ascontiguousarray(image, np.float32)
