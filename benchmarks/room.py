"""The box room of benchmarks, drawn in closed form as tests draw theirs: images and range to time with; maps of it."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from worlds import localizer, room

HALF_SIDES_M = (6.0, 4.0, 2.5)
COARSEST, FINEST, NUM_WAVES = 1.5, 40.0, 24  # radians per metre; of its texture


def make_room(
    seed: int, half_sides_m: tuple[float, float, float] = HALF_SIDES_M, finest: float = FINEST, kind: Any = room.Room
) -> Any:
    """Return the room whose texture follows from a seed."""
    return kind(half_sides_m, (COARSEST, finest, NUM_WAVES), gain=30.0, seed=seed)


def look(place: Any, camera: Camera, T_room_camera: SE3) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the grey image and the range in m (H, W) that a camera sees of a room."""
    gray, range_m = place.render(camera, T_room_camera)
    return np.rint(gray).astype(np.uint8), range_m


def graph_of(place: Any, camera: Spherical, poses: Iterable[SE3], step_ns: int = 1) -> SphereGraph:
    """Return key spheres of a room, or of another place that renders."""
    nodes = []
    for number, T in enumerate(poses):
        stamp = step_ns * (number + 1)
        nodes.append(KeySphere(number, stamp, T, Sphere(*look(place, camera, T), camera, stamp)))
    return SphereGraph(nodes)


def motions(nodes: Iterable[KeySphere]) -> list[Edge]:
    """Return the true motion from each key sphere to the next."""
    return [Edge(a.id, b.id, a.T_map_sphere.inverse() @ b.T_map_sphere, 1e4 * np.eye(6)) for a, b in pairwise(nodes)]


class MemoryMap(localizer.MemoryMap):
    """A map in memory, as the localiser reads one."""

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return a copy of a sphere, so that nothing of it is computed before."""
        sphere = super().load_sphere(sphere_id)
        return Sphere(sphere.image, sphere.range_m, sphere.camera, sphere.stamp_ns)
