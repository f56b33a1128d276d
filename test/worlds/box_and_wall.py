"""A box before a wall: depth in closed form."""

from __future__ import annotations

import numpy as np

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_rays

WALL = 3.0  # m: a wall across the view
BOX = 1.5  # m: the front of a box before it, to the left of x = 0


def depth_of_box_and_wall(camera: Pinhole, T_scene_camera: SE3) -> np.ndarray:
    """Return the depth (H, W) in m: both faces are at constant z of the scene, whose axes are optical."""
    rays = pixel_rays(camera)
    rays = (rays / rays[..., 2:]) @ T_scene_camera.rotation.T
    t = T_scene_camera.translation
    on_box = (BOX - t[2]) / rays[..., 2]
    on_wall = (WALL - t[2]) / rays[..., 2]
    x = t[0] + on_box * rays[..., 0]
    return np.where(x < 0.0, on_box, on_wall)
