"""Depth seen by one camera, as another camera beside it sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3, Camera
from sphere_geometry.camera import pixel_grid
from sphere_mapping.kernels import sample_inverse_depth, splat_nearest

CORRECTIONS = 3  # steps along the ray after the warp; each removes most of the parallax that is left
MAX_LEFT = 0.01  # relative; more is a surface that the other camera does not see
MAX_STEP = 0.05  # relative difference of neighbours beyond which they are two surfaces

Depth = NDArray[np.float32]


def register_depth(depth_m: Depth, camera: Camera, target: Camera, T_target_camera: SE3) -> Depth:
    """Return the depth (H, W) along z of `target` in m, NaN where there is none, from that of `camera`.

    The points are warped forward with a z-buffer, two by two pixels each so that no holes open; then every pixel is
    corrected along its own ray by what `camera` measured there. The foreground does not bleed: what the correction does
    not confirm is dropped.
    """
    inverse = np.where(depth_m > 0, np.float32(1) / depth_m, np.float32(np.nan)).astype(np.float32)
    depth = _warped(inverse, camera, target, T_target_camera)
    rays = target.unproject(pixel_grid(target))
    rays = rays / rays[..., 2:]
    T_camera_target = T_target_camera.inverse()
    slope = rays @ T_camera_target.rotation[2]  # z in `camera` per m of depth in `target`
    step = np.full(depth.shape, np.nan)
    for _ in range(CORRECTIONS):
        points = T_camera_target.apply(rays * depth[..., None])
        step = (_sampled(inverse, camera, points) - points[..., 2]) / slope
        depth = depth + step
    return np.where(np.abs(step) < MAX_LEFT * depth, depth, np.nan).astype(np.float32)


def _warped(inverse: Depth, camera: Camera, target: Camera, T_target_camera: SE3) -> NDArray[np.float64]:
    rays = camera.unproject(pixel_grid(camera))
    points = T_target_camera.apply((rays / rays[..., 2:] / inverse[..., None]).reshape(-1, 3))
    points = points[np.all(np.isfinite(points), axis=1) & (points[:, 2] > 0)]
    pixels, _ = target.project(points)
    nearest = np.full((target.height, target.width), np.inf, np.float32)
    u, v = np.ascontiguousarray(pixels.T, dtype=np.float32)
    splat_nearest(u, v, points[:, 2].astype(np.float32), False, nearest)
    return np.where(np.isinf(nearest), np.nan, nearest.astype(np.float64))


def _sampled(inverse: Depth, camera: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    pixels, _ = camera.project(points)
    u, v = np.ascontiguousarray(np.nan_to_num(pixels.reshape(-1, 2), nan=-1e4).T, dtype=np.float32)
    sampled = np.empty(u.size, np.float32)
    sample_inverse_depth(inverse, u, v, MAX_STEP, sampled)
    return (1.0 / sampled.astype(np.float64)).reshape(points.shape[:-1])
