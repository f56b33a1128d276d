"""Halls in which the dense localiser drives while something fails: their maps, their images, what may be wrong there.

All of it follows from a seed. Every other hall has no fine texture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.room import FINEST, MemoryMap, graph_of, make_room
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import Room

CAMERA = Pinhole(240, 180, 190.0, 190.0, 119.5, 89.5)
LONGER = replace(CAMERA, fx=0.8 * CAMERA.fx, fy=0.8 * CAMERA.fy)
SPHERE = Spherical(1024, 512)
HALF_SIDES_M, REACH_M, SPACING_M = (14.0, 4.0, 2.5), 11.0, 1.0  # of a hall; of the drive to and fro; of key spheres
SOFT = 14.0  # radians per metre: the finest texture of every other hall
NOISE = 2.0  # grey levels
ODOMETRY_NOISE = 0.01  # of the motion
ACCELERATION = 2.0  # m/s^2
KIDNAPPED = SE3.exp([0.6, 0.0, -0.8, 0.0, 0.7, 0.0])
LATE = 8  # images
THIRD = slice(CAMERA.width // 3, 2 * (CAMERA.width // 3))  # of a view, that is seen three times

Image = NDArray[np.uint8]
Lamp = Callable[[Array], Array]


def draw_lamp(rng: np.random.Generator) -> Lamp:
    """Return the light of a lamp anywhere along the drive, beyond which all is darker, in one half of the hall or both.

    It is a factor (...,) of the grey levels of points (..., 3) of the walls.
    """
    place = rng.uniform(-1.0, 1.0, 3) * (REACH_M, *HALF_SIDES_M[1:])
    size_m, bright, dark = rng.uniform(1.0, 3.0), rng.uniform(0.5, 2.0), rng.uniform(0.2, 1.0)
    side = float(rng.integers(-1, 2))

    def light(points: Array) -> Array:
        near = np.exp(np.sum((points - place) ** 2, axis=-1) * (-0.5 / size_m**2))
        return np.where(side * points[..., 1] < 0.0, 1.0, dark + bright * near)

    return light


class Hall(Room):
    """A room in which a lamp may be switched."""

    lamp: Lamp | None = None

    def gray(self, points: Any) -> Any:
        """Return grey levels of points (..., 3)."""
        gray = super().gray(points)
        return gray if self.lamp is None else np.clip(gray * self.lamp(points), 0.0, 255.0)


class World:
    """A hall and its map, a camera that drives to and fro and turns all the while, and odometry.

    `T_map_camera`, `T_odom_camera` are where the camera is, `before` the last images' places, the oldest first.
    """

    def __init__(self, seed: int, *, is_soft: bool) -> None:
        self.rng, self.phase, self.seconds, self.speed = np.random.default_rng(seed), 0.0, 0.0, 0.0
        finest = SOFT if is_soft else FINEST
        self.room, self.other = (make_room(seed + off, HALF_SIDES_M, finest, Hall) for off in (0, 1000))
        places = [SE3.from_planar(x, 0.0, 0.0) for x in np.arange(-REACH_M, REACH_M + 0.5, SPACING_M)]
        self.map = MemoryMap(graph_of(self.room, SPHERE, places))
        self.patch = self.rng.integers(0, 255, (CAMERA.height // 20, CAMERA.width // 20)).astype(np.uint8)
        self.lamp = draw_lamp(self.rng)
        self.T_odom_camera, self.before = SE3.identity(), [self.T_map_camera] * (LATE + 1)

    @property
    def T_map_camera(self) -> SE3:
        """Where the camera is."""
        x, y = 0.97 * REACH_M * np.sin(self.phase), 0.4 * np.sin(0.7 * self.seconds)
        yaw = 0.5 * np.sin(0.5 * self.seconds) + 0.1 * self.seconds
        return SE3.from_planar(x, y, yaw) @ T_BODY_OPTICAL

    def drive(self, seconds: float, speed: float) -> float:
        """Move the camera on, faster or slower until it has the speed; return by how many metres."""
        change = ACCELERATION * seconds
        self.speed += float(np.clip(speed - self.speed, -change, change))
        self.seconds += seconds
        self.phase += self.speed * seconds / REACH_M
        moved = (self.before[-1].inverse() @ self.T_map_camera).log()
        self.T_odom_camera = self.T_odom_camera @ SE3.exp(moved * (1.0 + ODOMETRY_NOISE * self.rng.normal(size=6)))
        self.before = [*self.before[1:], self.T_map_camera]
        return float(np.linalg.norm(moved[:3]))

    def jump(self) -> None:
        """Be anywhere on the way."""
        self.phase, self.seconds = self.rng.uniform(0.0, 2 * np.pi), self.rng.uniform(0.0, 500.0)
        self.before = [self.T_map_camera] * (LATE + 1)

    def see(self, T_map_camera: SE3, camera: Pinhole = CAMERA, lamp: Lamp | None = None, room: Any = None) -> Image:
        """Return an image with noise; `room`: another one."""
        self.room.lamp = lamp
        return _noisy((room or self.room).render(camera, T_map_camera)[0], self.rng)


def _noisy(gray: NDArray[np.float32], rng: np.random.Generator) -> Image:
    noise = rng.standard_normal(gray.shape, np.float32)
    return np.clip(np.rint(gray + np.float32(NOISE) * noise), 1, 255).astype(np.uint8)


Fault = Callable[[World], Image]


def nothing(world: World) -> Image:
    """See what is there."""
    return world.see(world.T_map_camera)


def kidnapped(world: World) -> Image:
    """See from another place than odometry says."""
    return world.see(world.T_map_camera @ KIDNAPPED)


def elsewhere(world: World) -> Image:
    """See another hall."""
    return world.see(world.T_map_camera, room=world.other)


def _occluded(world: World, share: float) -> Image:
    image, patch = nothing(world), np.kron(world.patch, np.ones((20, 20), np.uint8))
    image[:, : int(share * CAMERA.width)] = patch[:, : int(share * CAMERA.width)]
    return image


def _lit(world: World, gain: float, bias: float) -> Image:
    return np.clip(gain * nothing(world).astype(float) + bias, 1, 255).astype(np.uint8)


# Light is no fault of the pose: it may be told, and must not be wrong.
FAULTS: dict[str, Fault] = {
    "covered": lambda world: _noisy(np.full((CAMERA.height, CAMERA.width), 20.0, np.float32), world.rng),
    "40 % occluded": partial(_occluded, share=0.4),
    "70 % occluded": partial(_occluded, share=0.7),
    "saturated": partial(_lit, gain=2.2, bias=0.0),
    "other light": partial(_lit, gain=0.35, bias=60.0),
    "a lamp switched": lambda world: world.see(world.T_map_camera, lamp=world.lamp),
    "another place": elsewhere,
    "kidnapped": kidnapped,
    "focal length 20 % off": lambda world: world.see(world.T_map_camera, LONGER),
    "images 0.5 s late": lambda world: world.see(world.before[0]),
    "repeated texture": lambda world: np.ascontiguousarray(np.tile(nothing(world)[:, THIRD], (1, 3))),
    "wrong start": nothing,
}
