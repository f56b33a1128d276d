"""A box room whose walls carry smooth texture of many scales, drawn in closed form: images and range to time with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3, Camera
from sphere_geometry.camera import pixel_grid

HALF_SIDES_M = np.array([6.0, 4.0, 2.5])
NUM_WAVES = 24


def render(
    camera: Camera,
    T_room_camera: SE3,
    seed: int = 0,
    contrast: Callable[[NDArray[np.float64]], NDArray[np.float64] | np.float64] = lambda _: np.float64(1.0),
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the grey image (H, W) and the range along the ray (H, W) in metres, as `camera` sees the room.

    `contrast` says at points (H, W, 3) in m of the walls how much of their texture (H, W) is left.
    """
    rays, range_m = hit_walls(camera, T_room_camera, HALF_SIDES_M)
    points_room = T_room_camera.translation + rays * range_m[..., None]
    return _grey(points_room, np.random.default_rng(seed), contrast(points_room)), range_m.astype(np.float32)


def hit_walls(
    camera: Camera, T_box_camera: SE3, half_sides_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rays (H, W, 3) of a camera in a box, in its axes, and how far they go (H, W); sides may be endless."""
    rays = camera.unproject(pixel_grid(camera)) @ T_box_camera.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        hits = (np.sign(rays) * half_sides_m - T_box_camera.translation) / rays
    return rays, np.nanmin(np.where(rays == 0, np.inf, hits), axis=-1)


def _grey(
    points_room: NDArray[np.float64], rng: np.random.Generator, contrast: NDArray[np.float64] | np.float64
) -> NDArray[np.uint8]:
    grey = np.zeros(points_room.shape[:-1])
    for frequency in np.geomspace(1.5, 40.0, NUM_WAVES):  # radians per metre
        direction = rng.normal(size=3)
        wave = points_room @ (frequency * direction / np.linalg.norm(direction)) + rng.uniform(0.0, 2 * np.pi)
        grey += 30.0 / np.sqrt(frequency) * np.sin(wave)
    return np.clip(np.rint(128.0 + contrast * grey), 0, 255).astype(np.uint8)
