"""A box room whose walls carry smooth texture of many scales, drawn in closed form: images and range to time with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import Sphere

HALF_SIDES_M = (6.0, 4.0, 2.5)
NUM_WAVES = 24
COARSEST, FINEST = 1.5, 40.0  # radians per metre
CHUNK = 8192  # points drawn at once: what fits into a cache

Factor = Callable[[NDArray[np.float32]], NDArray[np.floating]]  # points (N, 3) in m of the walls -> (N,)


@dataclass(frozen=True)
class Room:
    """Walls whose texture follows from a seed, with no waves shorter than 2 pi / `finest` m."""

    seed: int = 0
    half_sides_m: tuple[float, float, float] = HALF_SIDES_M
    finest: float = FINEST

    def render(
        self, camera: Camera, T_room_camera: SE3, light: Factor | None = None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return the grey image (H, W) and range (H, W) in metres; `light` is a factor of the grey levels."""
        rays, range_m = hit_walls(camera, T_room_camera, np.array(self.half_sides_m))
        points = (T_room_camera.translation + rays * range_m[..., None]).astype(np.float32).reshape(-1, 3)
        gray = np.concatenate([self._gray(points[k : k + CHUNK], light) for k in range(0, len(points), CHUNK)])
        return gray.reshape(range_m.shape), range_m.astype(np.float32)

    def _gray(self, points: NDArray[np.float32], light: Factor | None) -> NDArray[np.uint8]:
        waves, phases, amplitudes = self._waves
        phase = points @ waves
        phase += phases
        gray = np.sin(phase, out=phase) @ amplitudes
        gray += np.float32(128.0)
        if light is not None:
            gray *= light(points)
        return np.clip(np.rint(gray), 0, 255).astype(np.uint8)

    @cached_property
    def _waves(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Wave vectors (3, N) in radians per metre, phases (N,) and amplitudes (N,) in grey levels."""
        rng = np.random.default_rng(self.seed)
        frequencies = np.geomspace(COARSEST, self.finest, NUM_WAVES)
        waves, phases = np.empty((3, NUM_WAVES), np.float32), np.empty(NUM_WAVES, np.float32)
        for index, frequency in enumerate(frequencies):
            direction = rng.normal(size=3)
            waves[:, index] = frequency * direction / np.linalg.norm(direction)
            phases[index] = rng.uniform(0.0, 2 * np.pi)
        return waves, phases, (30.0 / np.sqrt(frequencies)).astype(np.float32)


@dataclass
class MemoryMap:
    """A map in memory, as the localiser reads one."""

    graph: SphereGraph

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return a copy of a sphere, so that nothing of it is computed before."""
        sphere = self.graph[sphere_id].sphere
        assert sphere is not None
        return Sphere(sphere.image, sphere.range_m, sphere.camera, sphere.stamp_ns)

    def appearance(self) -> AppearanceIndex:
        """Return what they look like."""
        index = AppearanceIndex()
        for node in self.graph:
            index.add(node.id, features_of_sphere(self.load_sphere(node.id)))
        return index

    def coarse_spheres(self) -> Mapping[int, Sphere]:
        """Return all spheres small."""
        return {node.id: coarse_sphere(self.load_sphere(node.id)) for node in self.graph}


def render(camera: Camera, T_room_camera: SE3, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return what a camera sees of the room that most benchmarks use, as `Room.render`."""
    return Room(seed).render(camera, T_room_camera)


def hit_walls(
    camera: Camera, T_box_camera: SE3, half_sides_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rays (H, W, 3) of a camera in a box, in its axes, and how far they go (H, W); sides may be endless."""
    rays = _rays(camera) @ T_box_camera.rotation.T
    range_m = np.full(rays.shape[:-1], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(3):
            ray = np.ascontiguousarray(rays[..., axis])
            hits = (np.copysign(half_sides_m[axis], ray) - T_box_camera.translation[axis]) / ray
            np.fmin(range_m, hits, out=range_m, where=ray != 0)
    return rays, range_m


@lru_cache(maxsize=4)
def _rays(camera: Camera) -> NDArray[np.float64]:
    """Return the rays (H, W, 3) of a camera in its own axes."""
    return pixel_rays(camera)
