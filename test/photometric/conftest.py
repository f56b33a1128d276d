"""A textured box room with closed-form range: the truth for everything photometric."""

from __future__ import annotations

import numpy as np
import pytest

from sphere_geometry import SE3
from sphere_geometry.camera import pixel_grid

HALF = np.array([4.0, 3.0, 1.5])  # m, half the sides of the room


class Room:
    """Every wall carries waves of many lengths; grey levels 0..255."""

    def __init__(self, seed: int = 7) -> None:
        rng = np.random.default_rng(seed)
        directions = rng.normal(size=(40, 3))
        self.k = directions / np.linalg.norm(directions, axis=1, keepdims=True) * np.geomspace(1.5, 25.0, 40)[:, None]
        self.phase = rng.uniform(0, 2 * np.pi, 40)
        self.amplitude = 25.0 / np.linalg.norm(self.k, axis=1) ** 0.5

    def grey(self, points_room):
        waves = np.sin(points_room @ self.k.T + self.phase) @ self.amplitude
        return np.clip(128.0 + waves, 0.0, 255.0)

    def render(self, camera, T_room_camera: SE3):
        """Return the grey image (H, W) float32 and the range along the ray (H, W) in metres."""
        rays = camera.unproject(pixel_grid(camera)) @ T_room_camera.rotation.T
        origin = T_room_camera.translation
        with np.errstate(divide="ignore"):
            hits = (np.sign(rays) * HALF - origin) / rays
        range_m = np.min(np.where(rays == 0, np.inf, hits), axis=-1)
        points = origin + rays * range_m[..., None]
        return np.nan_to_num(self.grey(points)).astype(np.float32), range_m.astype(np.float32)


@pytest.fixture(scope="session")
def room() -> Room:
    return Room()
