"""Depth seen by one camera, as another camera beside it, or the centre of a sphere, sees it."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import DEPTH_CORRECTIONS, MAX_CORRECTION, MAX_DEPTH_STEP
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array, Flags, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays


def inverse_depth(depth_m: NDArray[np.floating]) -> Floats:
    """Return 1 / depth; +Inf (known to be far) becomes 0; NaN, -Inf, zero and negative depth become NaN."""
    depth = np.asarray(depth_m, dtype=np.float32)
    return np.divide(1.0, depth, out=np.full(depth.shape, np.nan, dtype=np.float32), where=depth > 0)


def sample_inverse(inverse: Floats, u: Floats, v: Floats) -> Floats:
    """Return inverse depth at pixels u, v (H, W), never mixed across an edge; NaN outside.

    Linear (as a plane's is in the pixels of a pinhole) where the four neighbours are measured and differ by at most
    MAX_DEPTH_STEP of the largest, else that of the nearest pixel.
    """
    four, known = np.ones((2, 2), np.uint8), np.nan_to_num(inverse, nan=-1.0)
    largest, least = (extreme(known, four, anchor=(0, 0)) for extreme in (cv2.dilate, cv2.erode))
    is_smooth = largest - least <= MAX_DEPTH_STEP * largest
    height, width = inverse.shape
    row, column = (np.clip(np.floor(at), 0, last).astype(np.intp) for at, last in ((v, height - 2), (u, width - 2)))
    nearest = cv2.remap(inverse, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
    linear = cv2.remap(inverse, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(is_smooth[row, column] & ~np.isnan(nearest), linear, nearest)


def pixels_of(points: Array, camera: Camera) -> tuple[Floats, Floats, Flags]:
    """Return u, v of points (H, W, 3) in the frame of the camera and which of them are seen."""
    pixels, visible = camera.project(points)
    u, v = np.ascontiguousarray(np.moveaxis(np.nan_to_num(pixels, nan=-1e4), -1, 0), dtype=np.float32)
    return u, v, visible


def draw_nearest(points: Array, target: Camera, size: int) -> Floats:
    """Return the range (H, W) of the nearest of points (N, 3), each drawn size x size px wide; +Inf where none is."""
    pixels, _ = target.project(points)
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    first = np.floor(np.clip(pixels[seen].astype(np.float32), -1e6, 1e6) - (0.5 * size - 1)).astype(np.intp)
    ranges = np.linalg.norm(points[seen], axis=1).astype(np.float32)
    nearest = np.full((target.height, target.width), np.inf, np.float32)
    for dv, du in np.ndindex(size, size):
        u, v = first[:, 0] + du, first[:, 1] + dv
        u = u % target.width if target.is_whole else u
        is_in = (u >= 0) & (u < target.width) & (v >= 0) & (v < target.height)
        np.minimum.at(nearest.ravel(), v[is_in] * target.width + u[is_in], ranges[is_in])
    return nearest


class DepthRegistration:
    """Turns depth along z of `camera` into what `target` sees; the rays of both are computed once.

    Points are warped, and the depth of each pixel of the target is corrected by what was measured in its direction.
    """

    def __init__(self, camera: Camera, target: Camera, T_target_camera: SE3) -> None:
        self._camera, self._target = camera, target
        self._rays, rays_camera = pixel_rays(target), pixel_rays(camera)
        rays_camera = (rays_camera / rays_camera[..., 2:]) @ T_target_camera.rotation.T
        T_camera_target = T_target_camera.inverse()
        self._to_target = T_target_camera.translation, rays_camera
        self._to_camera = T_camera_target.translation, self._rays @ T_camera_target.rotation.T

    @classmethod
    def between(cls, camera: Camera, target: Camera, T_target_camera: SE3) -> DepthRegistration:
        """Return that of two cameras and their place; of the latest ones the rays are known."""
        return _between(camera, target, T_target_camera.matrix.tobytes())

    def __call__(self, depth_m: NDArray[np.floating]) -> Floats:
        """Return the depth (H, W) of `target` along z in m, NaN where there is none."""
        return (self.ranges(inverse_depth(depth_m)) * self._rays[..., 2]).astype(np.float32)

    def ranges(self, inverse: Floats) -> Array:
        """Return the range (H, W) along the rays of `target` in m of inverse depth (h, w), NaN where there is none."""
        origin, rays = self._to_camera
        range_m, step = self._warp(inverse), np.zeros(0)
        for _ in range(DEPTH_CORRECTIONS):
            points = rays * range_m[..., None] + origin
            step = (self._measure(inverse, points) - points[..., 2]) / np.maximum(rays[..., 2], 0.1)
            range_m = range_m + step
        return np.where(np.abs(step) < MAX_CORRECTION * range_m, range_m, np.nan)

    def _warp(self, inverse: Floats) -> Array:
        """Return the range of `target` to about a pixel, NaN where nothing falls."""
        origin, rays = self._to_target
        with np.errstate(divide="ignore", invalid="ignore"):
            points = rays / inverse[..., None] + origin
        nearest = draw_nearest(points[np.isfinite(points).all(axis=-1)], self._target, 2)
        return np.where(np.isfinite(nearest), nearest, np.nan)

    def _measure(self, inverse: Floats, points: Array) -> Array:
        """Return the depth that `camera` measured in the direction of points (H, W, 3)."""
        u, v, _ = pixels_of(points, self._camera)
        with np.errstate(divide="ignore"):
            return 1.0 / sample_inverse(inverse, u, v).astype(np.float64)


@lru_cache(maxsize=16)
def _between(camera: Camera, target: Camera, T_target_camera: bytes) -> DepthRegistration:
    return DepthRegistration(camera, target, SE3(np.frombuffer(T_target_camera).reshape(4, 4)))
