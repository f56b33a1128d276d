"""Cameras as parameter vectors: (fx, fy, cx, cy, distortion...), padded to one length for all models.

The projection is that of `sphere_nav.geometry`, without its limit to the image and to monotonic distortion: on its way
the adjustment may pass through lenses that fold back outside of what was seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Camera, Fisheye, Pinhole
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.pinhole import MIN_DEPTH

NUM_LENS = 12  # fx fy cx cy and up to eight coefficients
MODELS: dict[str, type[Pinhole] | type[Fisheye]] = {"pinhole": Pinhole, "fisheye": Fisheye}


def lens_of(camera: Camera) -> Array:
    """Return the parameters (12,) of a pinhole or fisheye camera, zeros behind its own."""
    if not isinstance(camera, Pinhole | Fisheye):
        raise ValueError(f"model: expected one of {', '.join(MODELS)}, found {camera.model!r}")
    own = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion]
    return np.concatenate([own, np.zeros(NUM_LENS - len(own))])


def camera_from_vector(model: str, size: tuple[int, int], lens: Array, num_distortion: int) -> Camera:
    """Return the camera of a parameter vector; a pinhole keeps its first `num_distortion` coefficients."""
    fx, fy, cx, cy, *k = (float(value) for value in lens)
    width, height = size
    if model == "fisheye":
        return Fisheye(width, height, fx, fy, cx, cy, (k[0], k[1], k[2], k[3]))
    return Pinhole(width, height, fx, fy, cx, cy, tuple(k[:num_distortion]))


def free_parameters(model: str, num_distortion: int) -> NDArray[np.bool_]:
    """Return which of the 12 parameters a model has."""
    count = 4 + (4 if model == "fisheye" else num_distortion)
    return np.arange(NUM_LENS) < count


def project_points(model: str, lens: Array, points: Array) -> Array:
    """Return pixels (N, 2) of points (N, 3) in the camera frame; NaN behind a pinhole."""
    flat, _ = _fisheye(lens, points) if model == "fisheye" else _pinhole(lens, points)
    return flat * lens[:2] + lens[2:4]


def J_lens(model: str, lens: Array, points: Array) -> Array:
    """Return d pixel / d parameters (N, 2, 12)."""
    flat, J_distortion = _fisheye(lens, points) if model == "fisheye" else _pinhole(lens, points)
    J = np.zeros((len(points), 2, NUM_LENS))
    J[:, 0, 0], J[:, 1, 1] = flat[:, 0], flat[:, 1]
    J[:, 0, 2] = J[:, 1, 3] = 1.0
    J[:, :, 4:] = J_distortion * lens[:2, None]
    return J


def _pinhole(lens: Array, points: Array) -> tuple[Array, Array]:
    """Return distorted coordinates (N, 2) on the plane z = 1 and their derivative (N, 2, 8) by the coefficients."""
    depth = np.where(points[:, 2] > MIN_DEPTH, points[:, 2], np.nan)
    x, y = points[:, 0] / depth, points[:, 1] / depth
    k1, k2, p1, p2, k3, k4, k5, k6 = lens[4:]
    r2 = x * x + y * y
    numerator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = numerator / denominator
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    xy = np.stack([x, y], axis=-1)
    J = np.empty((len(points), 2, 8))
    powers = np.stack([r2, r2**2, r2**3], axis=-1)[:, None, :] * (xy / denominator[:, None])[:, :, None]
    J[:, :, [0, 1, 4]] = powers
    J[:, :, 5:] = -radial[:, None, None] * powers
    J[:, 0, 2], J[:, 1, 2] = 2 * x * y, r2 + 2 * y * y
    J[:, 0, 3], J[:, 1, 3] = r2 + 2 * x * x, 2 * x * y
    return np.stack([u, v], axis=-1), J


def _fisheye(lens: Array, points: Array) -> tuple[Array, Array]:
    sine = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(sine, points[:, 2])
    direction = points[:, :2] / np.maximum(sine, 1e-12)[:, None]
    powers = angle[:, None] ** np.array([3, 5, 7, 9])
    radius = angle + powers @ lens[4:8]
    J = np.zeros((len(points), 2, 8))
    J[:, :, :4] = direction[:, :, None] * powers[:, None, :]
    return direction * radius[:, None], J
