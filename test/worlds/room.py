"""A box room whose walls carry waves of many lengths: grey level and range of any ray in closed form."""

from __future__ import annotations

import numpy as np

from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.cameras.rolling_shutter import row_share
from sphere_nav.photometric import View, prepare_reference
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.structure import find_rig_structure
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

SPHERE = Spherical(512, 256)
TWO_PLACES = (SE3.identity(), SE3.exp([0.3, 0.0, 0.1, 0.0, 0.0, 0.0]))
BESIDE = SE3.exp([0.1, -0.05, 0.2, 0.02, 0.3, 0.01])  # where images are taken


class Room:
    """Seen from inside: `half` its half sides in m; `wave_numbers` from, to, and how many of its texture, in rad/m."""

    def __init__(self, half=(4.0, 3.0, 1.5), wave_numbers=(1.5, 25.0, 40), gain=25.0, slope=0.5, seed: int = 7) -> None:
        rng = np.random.default_rng(seed)
        size = np.geomspace(*wave_numbers)
        directions = rng.normal(size=(len(size), 3))
        self.half = np.array(half)
        self.k = directions / np.linalg.norm(directions, axis=1, keepdims=True) * size[:, None]
        self.phase = rng.uniform(0, 2 * np.pi, len(size))
        self.amplitude = gain / size**slope

    def gray(self, points):
        """Return grey levels 1..254 of points (..., 3)."""
        return np.clip(128.0 + self.waves(points, self.amplitude), 1.0, 254.0)

    def waves(self, points, amplitudes):
        """Return sums (..., N) of the waves by amplitudes (K, N) at points (..., 3), exact to a thousandth."""
        k, phase, amplitudes = (np.asarray(a, np.float32) for a in (self.k.T, self.phase, amplitudes))
        parts = np.array_split(np.asarray(points, np.float32).reshape(-1, 3), 1 + points.size // 6000)  # in the cache
        sums = np.concatenate([np.sin(part @ k + phase) @ amplitudes for part in parts])
        return sums.reshape(*points.shape[:-1], *amplitudes.shape[1:]).astype(float)

    def cast(self, origin, rays):
        """Return grey level and range (m) of unit rays (..., 3) from a point inside; NaN where a ray is NaN."""
        with np.errstate(divide="ignore", invalid="ignore"):
            hits = (np.sign(rays) * self.half - origin) / rays
        range_m = np.min(np.where(rays == 0, np.inf, hits), axis=-1)
        return self.gray(origin + rays * range_m[..., None]), range_m

    def render(self, camera: Camera, T_room_camera: SE3):
        """Return the grey image (H, W) float32, 0 where the camera sees nothing, and the range (H, W) float32 in m."""
        rays = pixel_rays(camera) @ T_room_camera.rotation.T
        gray, range_m = self.cast(T_room_camera.translation, rays)
        return np.nan_to_num(gray).astype(np.float32), range_m.astype(np.float32)

    def render_rolling(self, camera: Camera, T_room_camera: SE3, twist):
        """Return the grey image (H, W) float32 of a rolling shutter; the pose is that of the middle row."""
        return np.nan_to_num(self._cast_rows(camera, T_room_camera, twist)[0]).astype(np.float32)

    def range_rolling(self, camera: Camera, T_room_camera: SE3, twist):
        """Return the range (H, W) float32 in m, each row's from where the camera was then."""
        return self._cast_rows(camera, T_room_camera, twist)[1].astype(np.float32)

    def _cast_rows(self, camera: Camera, T_room_camera: SE3, twist):
        rays = pixel_rays(camera)
        rows = SE3.exp(row_share(np.arange(camera.height), camera.height)[:, None] * np.asarray(twist))
        T = SE3(T_room_camera.matrix @ rows.matrix)
        return self.cast(T.translation[:, None, :], np.einsum("vij,vuj->vui", T.rotation, rays))

    def photograph(self, camera: Camera, T_room_camera: SE3, seed: int = 0, noise: float = 2.0):
        """Return an image (H, W) uint8, with noise in grey levels."""
        gray, _ = self.render(camera, T_room_camera)
        noisy = gray + np.random.default_rng(seed).normal(0, noise, gray.shape) if noise else gray
        return np.clip(np.rint(noisy), 1, 255).astype(np.uint8)

    def rgbd(self, camera: Camera, T_room_camera: SE3):
        """Return an image (H, W) uint8 and the depth along z (H, W) float32 in m."""
        _, range_m = self.render(camera, T_room_camera)
        depth_m = range_m * pixel_rays(camera)[..., 2]
        return self.photograph(camera, T_room_camera, noise=0.0), depth_m.astype(np.float32)

    def sphere(self, T_room_sphere: SE3, camera: Spherical, seed: int = 0) -> Sphere:
        """Return the augmented sphere at a place."""
        _, range_m = self.render(camera, T_room_sphere)
        return Sphere(self.photograph(camera, T_room_sphere, 1000 + seed), range_m, camera)


def wide_room() -> Room:
    """Return a room for drives, of larger patterns."""
    return Room((5.0, 3.0, 1.5), (1.0, 20.0, 30), gain=30.0)


def sharp_room(half=(4.0, 3.0, 2.0), shortest: float = 0.25, seed: int = 7) -> Room:
    """Return a room whose patterns, the `shortest` m long, are all as strong: for matching and small images."""
    return Room(half, (2 * np.pi / shortest, 2 * np.pi / 2.5, 24), gain=9.0, slope=0.0, seed=seed)


def optical(T_room_body: SE3) -> SE3:
    """Return the pose of a camera that looks along the body's x axis."""
    return T_room_body @ T_BODY_OPTICAL


def soft_room(seed: int) -> Room:
    """Return a room without fine texture."""
    return Room((4.0, 3.0, 2.0), (1.0, 14.0, 30), gain=30.0, seed=seed)


def views_of(room, params, sphere=SPHERE, places=TWO_PLACES):
    """Return references of what spheres saw at the places."""
    return [View(prepare_reference(*room.render(sphere, T), sphere, params), T) for T in places]


def structure_of(pyramid, views, *rest):
    """Check the images of one camera."""
    return find_rig_structure([RigImage(pyramid, views=tuple(views))], *rest)
