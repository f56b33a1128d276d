"""A furnished room by a lamp, and a drive through it: what depth alone tells apart."""

from __future__ import annotations

import numpy as np

from mcl_depth.geometry.mesh import mesh_from_faces
from sphere_nav.geometry.cameras.camera import pixel_grid

from .boxes import box

LAMP = np.array([0.3, 0.2, 1.2])
POSES = [np.array([-2.0 + 0.25 * k, -1.0 + 0.05 * k, 0.1]) for k in range(14)]


def room():
    """Return the mesh of the room: two shelves and a cupboard in it."""
    parts = [box((-3, -2, 0), (3, 2.5, 2.6)), box((1.0, 1.2, 0), (2.2, 2.5, 2.0)), box((-3, 1.6, 0), (-2, 2.5, 1.7))]
    vertices = np.concatenate([*parts, box((2.2, -2, 0), (3, -1, 1.8))])
    return mesh_from_faces(vertices, np.arange(len(vertices)).reshape(-1, 3), "room")


def picture(site, pose):
    """Return what a camera sees of it: every point the brighter the nearer to the lamp."""
    camera, place = site.depth_map.camera, np.array([*pose[:2], 1.2])
    depth = site.synthesizer.synthesize_many(place[None])[0]
    points = place + np.nan_to_num(depth, nan=9.0)[..., None] * camera.unproject(pixel_grid(camera))
    bright = 255.0 / (1.0 + np.linalg.norm(points - LAMP, axis=-1))
    return np.roll(bright, round(pose[2] / (2 * np.pi) * camera.width), axis=1).astype(np.float32)
