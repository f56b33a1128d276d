"""Depth seen by one camera, as another camera beside it sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import DEPTH_CORRECTIONS, MAX_CORRECTION, MAX_SURFACE_STEP
from sphere_mapping.acquisition.kernels import sample_inverse_depth, splat_nearest
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays

Depth = NDArray[np.float32]


class DepthRegistration:
    """Turns depth images along z of `camera` into those of `target`; the rays of both are computed once.

    The points are warped forward with a z-buffer, two by two pixels each so that no holes open; then every pixel is
    corrected along its own ray by what `camera` measured there. The foreground does not bleed: what the correction does
    not confirm is dropped.
    """

    def __init__(self, camera: Camera, target: Camera, T_target_camera: SE3) -> None:
        T_camera_target = T_target_camera.inverse()
        self._camera, self._target = camera, target
        self._to_target = T_target_camera.translation, _rays(camera) @ T_target_camera.rotation.T
        self._to_camera = T_camera_target.translation, _rays(target) @ T_camera_target.rotation.T

    def __call__(self, depth_m: Depth) -> Depth:
        """Return the depth (H, W) of `target` in m, NaN where there is none."""
        with np.errstate(divide="ignore"):
            inverse = np.where(depth_m > 0, np.float32(1) / depth_m, np.float32(np.nan)).astype(np.float32)
        warped = self._warp(inverse).ravel()
        found = np.flatnonzero(np.isfinite(warped))
        depth, step = warped[found].astype(np.float64), np.zeros(found.size)
        origin, rays = self._to_camera[0], self._to_camera[1][found]
        for _ in range(DEPTH_CORRECTIONS):
            points = rays * depth[:, None] + origin
            step = (self._measure(inverse, points) - points[:, 2]) / rays[:, 2]
            depth = depth + step
        registered = np.full(warped.size, np.nan, np.float32)
        registered[found] = np.where(np.abs(step) < MAX_CORRECTION * depth, depth, np.nan)
        return registered.reshape(self._target.height, self._target.width)

    def _warp(self, inverse: Depth) -> Depth:
        """Return the depth of `target` to about a pixel, +Inf where nothing falls."""
        measured = np.flatnonzero(np.isfinite(inverse))
        origin, rays = self._to_target
        points = rays[measured] / inverse.ravel()[measured, None] + origin
        pixels, _ = self._target.project(points)
        u, v = np.ascontiguousarray(pixels.T, dtype=np.float32)
        nearest = np.full((self._target.height, self._target.width), np.inf, np.float32)
        splat_nearest(u, v, points[:, 2].astype(np.float32), False, nearest)
        return nearest

    def _measure(self, inverse: Depth, points: Array) -> Array:
        """Return the depth that `camera` measured in the direction of points (N, 3)."""
        pixels, _ = self._camera.project(points)
        u, v = np.ascontiguousarray(np.nan_to_num(pixels, nan=-1e4).T, dtype=np.float32)
        sampled = np.empty(u.size, np.float32)
        sample_inverse_depth(inverse, u, v, MAX_SURFACE_STEP, sampled)
        with np.errstate(divide="ignore"):
            return 1.0 / sampled.astype(np.float64)


def _rays(camera: Camera) -> Array:
    """Return a ray (H * W, 3) with z = 1 for every pixel."""
    rays = pixel_rays(camera).reshape(-1, 3)
    return rays / rays[:, 2:]
