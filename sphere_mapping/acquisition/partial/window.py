"""Which axes the sphere of a camera has, and which window of it the camera sees, at its own angular resolution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    LEVEL_RAD,
    MAX_STEEP_RAD,
    MIN_BLIND_ARC,
    OUTLINE_RAYS,
    WINDOW_LEVELS,
)
from sphere_nav.geometry import SE3, Camera, Spherical, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL


def full_width_for(pixels_per_radian: float) -> int:
    """Return the columns of the whole sphere of at least this resolution that WINDOW_LEVELS pyramid levels divide."""
    multiple = 2**WINDOW_LEVELS  # the height, half of it, must still be divisible WINDOW_LEVELS - 1 times
    return int(np.ceil(2 * np.pi * pixels_per_radian / multiple)) * multiple


def window_of(camera: Camera, T_sphere_camera: SE3, full_width: int) -> Spherical:
    """Return the smallest window, aligned to the coarsest level, that holds the view of the camera.

    The position of the camera beside the centre of the sphere is neglected. A view all around is a whole sphere.
    """
    rays = _rays_of_view(camera) @ T_sphere_camera.rotation.T
    first, span = _arc(np.arctan2(rays[:, 1], rays[:, 0]))
    if span > 2 * np.pi - MIN_BLIND_ARC or _sees_a_pole(camera, T_sphere_camera):
        return Spherical(full_width, full_width // 2)
    block = 2 ** (WINDOW_LEVELS - 1)
    scale = full_width / (2 * np.pi)
    elevation = np.arcsin(np.clip(rays[:, 2], -1.0, 1.0))
    # pixel edges: column u spans [u, u + 1) of (1/2 - azimuth / 2 pi) W
    left, right = full_width / 2 - (first + span) * scale, full_width / 2 - first * scale
    top, bottom = full_width / 4 - elevation.max() * scale, full_width / 4 - elevation.min() * scale
    u0, v0 = int(np.floor(left / block)) * block, max(int(np.floor(top / block)) * block, 0)
    u1, v1 = int(np.ceil(right / block)) * block, min(int(np.ceil(bottom / block)) * block, full_width // 2)
    return Spherical(min(u1 - u0, full_width), v1 - v0, float(full_width), float(u0), float(v0))


def place_in(window: Spherical, whole: Spherical) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows (h, 1) and columns (1, w) of a window in the whole sphere; columns wrap around."""
    rows = np.arange(window.height) + int(window.offset_v)
    columns = (np.arange(window.width) + int(window.offset_u)) % whole.width
    return rows[:, None], columns[None, :]


def upright_axes(T_base_body: SE3, camera: Camera) -> SE3:
    """Return T_sphere_body of spheres that are upright on the base, the camera in their middle column.

    `T_base_body` has the camera's body axes (x ahead, y left, z up). Where the lens would look into a pole of such
    spheres, which stretches its image, they have the camera's own axes.
    """
    ahead = T_base_body.rotation[:, 0]
    R = so3.exp([0.0, 0.0, -np.arctan2(ahead[1], ahead[0])]) @ T_base_body.rotation
    rays_body = _rays_of_view(camera) @ T_BODY_OPTICAL.rotation.T
    steepest = np.max(np.abs(rays_body @ R[2]))
    if np.allclose(R, np.eye(3), atol=LEVEL_RAD) or steepest > max(
        np.sin(MAX_STEEP_RAD), np.max(np.abs(rays_body[:, 2]))
    ):
        return SE3.identity()
    return SE3.from_parts(R, np.zeros(3))


def magnification(camera: Camera, window: Spherical) -> float:
    """Return how many camera pixels a window pixel spans where it spans most; well above 1 an image would alias."""
    per_radian = np.linalg.svd(camera.J_project(_rays_of_view(camera)), compute_uv=False)[:, 0]  # at unit range
    return float(np.max(per_radian)) / window.pixels_per_radian


def _rays_of_view(camera: Camera) -> Array:
    """Return unit rays (N, 3) all over the image, its outer edges included."""
    u = np.linspace(-0.5, camera.width - 0.5, OUTLINE_RAYS)
    v = np.linspace(-0.5, camera.height - 0.5, OUTLINE_RAYS)
    rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    rays = rays[np.all(np.isfinite(rays), axis=1)]
    if rays.size == 0:
        raise ValueError(f"{camera.model} camera: expected rays inside the image, found none (distortion)")
    return rays


def _arc(angles: Array) -> tuple[float, float]:
    """Return start and length of the shortest arc that holds all the angles, in radians."""
    ordered = np.sort(angles)
    gaps = np.diff(np.append(ordered, ordered[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    return float(ordered[(widest + 1) % ordered.size]), float(2 * np.pi - gaps[widest])


def _sees_a_pole(camera: Camera, T_sphere_camera: SE3) -> bool:
    poles_camera = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]) @ T_sphere_camera.rotation
    return bool(camera.project(poles_camera)[1].any())
