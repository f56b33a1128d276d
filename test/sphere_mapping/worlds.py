"""A room with a solid, smooth texture: grey level and range of any ray in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sphere_geometry import SE3
from sphere_geometry.camera import pixel_grid
from sphere_map.sphere import T_BODY_OPTICAL

NUM_WAVES = 24


@dataclass(frozen=True)
class Room:
    """A box around the origin, half sides in metres, seen from inside; wave lengths of the texture in metres."""

    half: tuple[float, float, float] = (4.0, 3.0, 2.0)
    seed: int = 7
    shortest: float = 0.25
    longest: float = 2.5

    def look(self, origin, rays):
        """Return grey level and range of unit rays (..., 3) from a point inside."""
        with np.errstate(divide="ignore", invalid="ignore"):
            to_wall = (np.sign(rays) * np.array(self.half) - origin) / rays
        range_m = np.nanmin(np.where(to_wall > 0, to_wall, np.inf), axis=-1)
        return self.texture(origin + rays * range_m[..., None]), range_m

    def texture(self, points):
        rng = np.random.default_rng(self.seed)
        length = np.geomspace(self.shortest, self.longest, NUM_WAVES)
        direction = rng.normal(size=(NUM_WAVES, 3))
        wave = direction / np.linalg.norm(direction, axis=1, keepdims=True) * (2 * np.pi / length)[:, None]
        phase = rng.uniform(0, 2 * np.pi, NUM_WAVES)
        amplitude = 9.0
        return 128.0 + sum(amplitude * np.sin(points @ k + p) for k, p in zip(wave, phase, strict=True))

    def photograph(self, camera, T_room_camera):
        """Return a grey image (H, W) uint8 and the depth along z in metres (H, W) float32 of a camera."""
        rays_camera = camera.unproject(pixel_grid(camera))
        grey, range_m = self.look(T_room_camera.translation, rays_camera @ T_room_camera.rotation.T)
        image = np.clip(np.rint(grey), 1, 255).astype(np.uint8)
        return image, (range_m * rays_camera[..., 2]).astype(np.float32)


def optical(T_room_body: SE3) -> SE3:
    """Return the pose of a camera that looks along the body's x axis."""
    return T_room_body @ T_BODY_OPTICAL
