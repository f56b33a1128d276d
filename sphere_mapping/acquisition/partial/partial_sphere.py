"""One camera with range -> a partial sphere: image and range in a window of the sphere.

The image is interpolated with care, because alignment lives on grey levels; range is never mixed across a depth edge.
A camera at the centre of the sphere is a pure resampling whose table is made once. A camera beside it is moved there
by its range: the points are splatted with a z-buffer, then corrected along each ray.

Where rows were read while the camera moved, pixels are found to first order in the motion (`rolling_shutter.py`): a
point p of the middle row is at p - s (v + omega x p) in the camera of its own row, s the share of that row; pixels move
as they do to the row of s = 1/2. Half of
(s omega)^2 in pixels is left: 0.03 px at 0.8 deg within a readout.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    MAX_MAGNIFICATION,
    MIN_RANGE_M,
    VERY_FAR_M,
)
from sphere_mapping.acquisition.partial.depth_registration import (
    DepthRegistration,
    inverse_depth,
    pixels_of,
    sample_inverse,
)
from sphere_mapping.acquisition.partial.window import full_width_for, magnification, window_of
from sphere_mapping.params import PartialParams
from sphere_nav.geometry import SE3, Camera, Spherical, so3
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.cameras.rolling_shutter import row_share
from sphere_nav.spheres.range_codec import MAX_RANGE
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere, check_depth, check_sphere_image, continued


@dataclass(frozen=True, eq=False)
class RgbdView:
    """What one RGB-D camera saw: image (H, W[, 3]) uint8, depth along z (H, W) in metres, NaN or <= 0 unknown.

    Depth is registered to the image. twist (6,) is the motion (v, omega) of the sphere, whose centre is the camera's,
    while all rows were read. relative_std (H, W) of the depth, where that is known.
    """

    image: Bytes
    depth_m: NDArray[np.floating]
    camera: Camera
    T_sphere_camera: SE3 = T_BODY_OPTICAL
    twist: Array | None = None
    relative_std: Floats | None = None

    def __post_init__(self) -> None:
        check_sphere_image(self.image, self.camera)
        check_depth(self.depth_m, self.camera)


def sphere_from_rgbd(
    image: Bytes,
    depth_m: NDArray[np.floating],
    camera: Camera,
    T_sphere_camera: SE3 = T_BODY_OPTICAL,
    stamp_ns: int = 0,
    params: PartialParams | None = None,
) -> Sphere:
    """Return the partial sphere of one RGB-D image whose depth (metres along z) is registered to its colour."""
    return sphere_from_view(RgbdView(image, depth_m, camera, T_sphere_camera), stamp_ns, params)


def sphere_from_view(view: RgbdView, stamp_ns: int = 0, params: PartialParams | None = None) -> Sphere:
    """Return the partial sphere of a camera at one instant, as fine as the camera, times `resolution`."""
    camera, place, resolution = view.camera, view.T_sphere_camera, (params or PartialParams()).resolution
    window = window_of(camera, place, full_width_for(camera.pixels_per_radian * resolution))
    image, range_m = _resample(view, window)
    relative = view.relative_std
    std_m = None if relative is None else range_m * resample_nearest(relative, camera, place, window)
    return Sphere(image, range_m, window, stamp_ns, std_m)


def _resample(view: RgbdView, window: Spherical) -> tuple[Bytes, Floats]:
    """Return image and range of a view in the window."""
    if view.twist is not None:
        return _resample_rolling(view, window, view.twist)
    range_m = resample_range(view.depth_m, view.camera, view.T_sphere_camera, window)
    image, seen = resample_image(view.image, view.camera, view.T_sphere_camera, window, range_m)
    return image, np.where(seen, range_m, np.float32(np.nan))


def _resample_rolling(view: RgbdView, window: Spherical, twist: Array) -> tuple[Bytes, Floats]:
    """Do as `_resample` for a camera that moved while it was read; its depth tells how far each row is off.

    Where no depth is known only the rotation counts.
    """
    camera, rotation = view.camera, view.T_sphere_camera.rotation
    inverse = inverse_depth(view.depth_m)
    u, v, seen, z_of_ray = _ray_table(camera, rotation.tobytes(), window)
    near = sample_inverse(inverse, u, v) * z_of_ray
    near = np.nan_to_num(continued(near, np.isfinite(near)))
    rays = _camera_rays(rotation.tobytes(), window).astype(np.float32)
    velocity, omega = (twist.reshape(2, 3) @ rotation).astype(np.float32)
    turn = rays @ so3.hat(omega).T.astype(np.float32)
    later = pixels_of(rays - 0.5 * (near[..., None] * velocity + turn), camera)  # by half a readout
    du, dv = 2.0 * (u - later[0]), 2.0 * (v - later[1])
    share = np.asarray(row_share(v, camera.height) / np.maximum(1.0 + dv / camera.height, 0.5), np.float32)
    u, v = u - share * du, v - share * dv
    z_of_ray, further = rays[..., 2] - share * turn[..., 2], share * (rays @ velocity)  # from there, for the middle row
    with np.errstate(divide="ignore"):
        range_m = 1.0 / (sample_inverse(inverse, u, v) * z_of_ray) + further
    seen = seen & (u >= 0) & (u <= camera.width - 1) & (v >= 0) & (v <= camera.height - 1)
    sampled = cv2.remap(view.image, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    image = np.maximum(sampled, 1) * (seen if sampled.ndim == 2 else seen[..., None])
    return image, np.where(seen, _trusted(range_m), np.float32(np.nan))


def resample_image(
    image: Bytes, camera: Camera, T_sphere_camera: SE3, window: Spherical, range_m: Floats
) -> tuple[Bytes, Flags]:
    """Return the image (height, width[, 3]) in the window and which of its pixels the camera sees."""
    if np.any(T_sphere_camera.translation):
        everywhere = np.nan_to_num(continued(range_m, np.isfinite(range_m)), nan=VERY_FAR_M)
        points = pixel_rays(window) * everywhere[..., None]
        u, v, seen = pixels_of(T_sphere_camera.inverse().apply(points), camera)
        sampled = cv2.remap(image, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    else:
        u, v, seen, steps = _image_table(camera, T_sphere_camera.rotation.tobytes(), window)
        sampled = cv2.remap(image, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        if steps > 1:
            sampled = cv2.resize(sampled, (window.width, window.height), interpolation=cv2.INTER_AREA)
    return np.maximum(sampled, 1) * (seen if sampled.ndim == 2 else seen[..., None]), seen


def resample_range(depth_m: NDArray[np.floating], camera: Camera, T_sphere_camera: SE3, window: Spherical) -> Floats:
    """Return the range along the rays (height, width) of the window from depth along the camera's z axis."""
    inverse = inverse_depth(depth_m)
    if np.any(T_sphere_camera.translation):
        range_m: NDArray[np.floating] = DepthRegistration.between(camera, window, T_sphere_camera).ranges(inverse)
    else:
        u, v, _, z_of_ray = _ray_table(camera, T_sphere_camera.rotation.tobytes(), window)
        with np.errstate(divide="ignore"):
            range_m = 1.0 / (sample_inverse(inverse, u, v) * z_of_ray)
    return _trusted(range_m)


def _trusted(range_m: NDArray[np.floating]) -> Floats:
    outside = (range_m < MIN_RANGE_M) | ((range_m > MAX_RANGE) & np.isfinite(range_m))
    return np.where(outside, np.nan, range_m).astype(np.float32)


def resample_nearest(values: Floats, camera: Camera, T_sphere_camera: SE3, window: Spherical) -> Floats:
    """Return values (H, W) of a camera at the centre of the sphere in the window, the nearest pixel's; NaN outside."""
    u, v, seen, _ = _ray_table(camera, T_sphere_camera.rotation.tobytes(), window)
    sampled = cv2.remap(values, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    return np.where(seen, sampled, np.float32(np.nan))


@lru_cache(maxsize=4)
def _camera_rays(rotation: bytes, window: Spherical) -> Array:
    """Return the unit rays (H, W, 3) of a window in the frame of the camera."""
    return pixel_rays(window) @ np.frombuffer(rotation).reshape(3, 3)


@lru_cache(maxsize=16)
def _ray_table(camera: Camera, rotation: bytes, window: Spherical) -> tuple[Floats, Floats, Flags, Floats]:
    """Return u, v, what is seen and the z of the unit ray in the camera frame, for each window pixel (same centre)."""
    rays = _camera_rays(rotation, window)
    return *pixels_of(rays, camera), rays[..., 2].astype(np.float32)


@lru_cache(maxsize=16)
def _image_table(camera: Camera, rotation: bytes, window: Spherical) -> tuple[Floats, Floats, Flags, int]:
    """Return the sampling positions, finer than the window where the camera is finer, and the number of steps."""
    steps = max(int(np.ceil(magnification(camera, window) / MAX_MAGNIFICATION)), 1)
    _, _, seen, _ = _ray_table(camera, rotation, window)
    finer = replace(
        window,
        width=window.width * steps,
        height=window.height * steps,
        full_width=window.full_width * steps,
        offset_u=window.offset_u * steps,
        offset_v=window.offset_v * steps,
    )
    u, v, _, _ = _ray_table(camera, rotation, finer)
    return u, v, seen, steps
