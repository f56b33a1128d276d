"""A street-like room by day, and by night with other boxes: light falls off, and turns contrast."""

from __future__ import annotations

import numpy as np

from sphere_nav.geometry import Spherical
from sphere_nav.spheres.sphere import Sphere
from worlds.parked import ParkingRoom, boxes_along
from worlds.submaps import submap_of

CAMERA = Spherical(384, 192)


def make_room(seed, boxes, places):
    """Return a room by its seed, and boxes by theirs."""
    return ParkingRoom(
        (8.0, 3.0, 1.5), (1.0, 40.0, 40), gain=30.0, seed=seed, boxes=boxes_along(boxes, places, height=1.8)
    )


DAY, NIGHT = make_room(7, 1, (0.0, 2.0, 4.0)), make_room(7, 9, (-0.7, 1.2, 3.2))
ELSEWHERE = make_room(31, 9, (-0.7, 1.2, 3.2))


def make_sphere(world, pose, *, is_dark):
    """Return what a whole sphere sees of a room."""
    gray, range_m = world.render(CAMERA, pose)
    gray = gray.astype(np.float32)
    if is_dark:
        gray *= 0.6 + 0.4 * np.cos(np.linspace(0.0, 2.0 * np.pi, CAMERA.width))[None, :]
        gray[:, 60:130] = gray[:, 60:130].max() - gray[:, 60:130]
    return Sphere(np.clip(gray, 1, 255).astype(np.uint8), range_m.astype(np.float32), CAMERA)


def make_submap(world, poses, first_id, T=None, *, is_dark):
    """Return a drive through a room."""
    made = [make_sphere(world, pose, is_dark=is_dark) for pose in poses]
    return submap_of(made.__getitem__, poses, first_id, T)
