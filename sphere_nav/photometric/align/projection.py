"""Cameras and pixels as kernels take them, and the cone of directions that each sees."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Camera
from sphere_nav.photometric.align.iteration import kernels
from sphere_nav.photometric.constants import CONE_GRID, CONE_MARGIN

Floats = NDArray[np.float32]
KernelCamera: TypeAlias = tuple[int, Floats, Floats]

MODELS = {
    "pinhole": kernels.PLANE,
    "double_sphere": kernels.PLANE,
    "omni": kernels.PLANE,
    "fisheye": kernels.FISHEYE,
    "spherical": kernels.SPHERICAL,
}
EVERYWHERE = np.array([0.0, 0.0, 1.0, np.pi], np.float32)


@lru_cache(maxsize=64)
def kernel_camera(camera: Camera) -> KernelCamera:
    """Return model number, coefficients (17,) and shutter (8,), a global one, float32, as the kernels take them."""
    coefficients = np.zeros(kernels.NUM_COEFFICIENTS, np.float32)
    coefficients[: camera.coefficients.size] = camera.coefficients
    return MODELS[camera.model], coefficients, np.zeros(8, np.float32)


def rolling(camera: Camera, twist: NDArray[np.float64]) -> KernelCamera:
    """Return the camera for kernels with the motion (6,) (v, omega) within its readout (cameras/rolling_shutter.py)."""
    model, coefficients, _ = kernel_camera(camera)
    return model, coefficients, np.array([*twist, 0.5 * (camera.height - 1), camera.height], np.float32)


@lru_cache(maxsize=64)
def view_cone(camera: Camera) -> Floats:
    """Return the cone that holds all rays of a camera: axis (3,) and half angle in radians, together (4,) float32."""
    if camera.is_whole:
        return EVERYWHERE
    u, v = np.linspace(-0.5, camera.width - 0.5, CONE_GRID), np.linspace(-0.5, camera.height - 0.5, CONE_GRID)
    rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1)).reshape(-1, 3)
    rays = rays[~np.isnan(rays[:, 0])]
    axis = rays.sum(axis=0)
    length = np.linalg.norm(axis)
    if not length > 0.1 * len(rays):  # all around, or nothing
        return EVERYWHERE
    angle = np.arccos(np.clip(np.min(rays @ (axis / length)), -1.0, 1.0)) + CONE_MARGIN
    return np.array([*(axis / length), min(angle, np.pi)], np.float32)


def in_blocks(pixels: Floats) -> Floats:
    """Return blocks of pixels (7, N), point, grey level and gradient, filled up with points that no camera sees."""
    rows, number = pixels.shape
    blocks = np.zeros((rows, -(-number // kernels.SIDE) * kernels.SIDE), np.float32)
    blocks[:, :number], blocks[:3, number:] = pixels, np.nan
    return np.ascontiguousarray(blocks.reshape(rows, -1, kernels.SIDE).swapaxes(0, 1)).reshape(-1)


def kernel_motion(matrix: NDArray[np.float64]) -> Floats:
    """Return the upper rows (3, 4) float32 of a rigid motion, as kernels take it."""
    return np.ascontiguousarray(matrix[:3], dtype=np.float32)
