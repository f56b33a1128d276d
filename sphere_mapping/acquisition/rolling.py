"""Where the pixels of a window are in an image whose rows were read while the camera moved.

To first order in the motion (sphere_geometry/shutter.py): a point p of the middle row is at p - s (v + omega x p) in
the camera of its own row, s the share of that row. Half of (s omega)^2 in pixels is left: 0.03 px at 0.8 deg within a
readout.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3, Camera, Spherical
from sphere_geometry.camera import pixel_grid

Plane = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rows:
    """Pixels u, v (H, W) of a window's rays in the image, each in its row; z_of_ray (H, W) in the camera of that row.

    `further` (H, W) m is to be added to a range measured from there, for the range from the middle row.
    """

    u: Plane
    v: Plane
    z_of_ray: Plane
    further: Plane


def roll(
    u: Plane, v: Plane, camera: Camera, T_sphere_camera: SE3, window: Spherical, twist: Array, near: Plane
) -> Rows:
    """Move pixels u, v (H, W) of the middle row to their own rows.

    twist (6,) is the motion within the readout in the frame of the sphere, near (H, W) the inverse range in 1/m, 0
    where it is not known: there only the rotation counts.
    """
    rays, J = _rays(camera, T_sphere_camera.rotation.tobytes(), window)
    velocity, omega = np.asarray(twist, np.float32).reshape(2, 3) @ T_sphere_camera.rotation.astype(np.float32)
    motion = near[..., None] * velocity + np.cross(omega, rays)  # of the ray, by a whole readout
    du, dv = np.einsum("vui,vui->vu", J[0], motion), np.einsum("vui,vui->vu", J[1], motion)
    rows = np.float32(camera.height)
    share = (v - 0.5 * (rows - 1)) / np.maximum(rows + dv, 0.5 * rows)
    z_of_ray = rays[..., 2] - share * np.cross(omega, rays)[..., 2]
    return Rows(u - share * du, v - share * dv, z_of_ray, share * (rays @ velocity))


@lru_cache(maxsize=4)
def _rays(camera: Camera, rotation: bytes, window: Spherical) -> tuple[Plane, Plane]:
    """Return the unit rays (H, W, 3) of a window in the camera, and the pixel's derivative (2, H, W, 3) by them."""
    rays = window.unproject(pixel_grid(window)) @ np.frombuffer(rotation).reshape(3, 3)
    ahead = np.where(rays[..., 2:] > 0.05, rays, (0.0, 0.0, 1.0))  # what the camera cannot see does not matter
    J = np.moveaxis(camera.J_project(ahead), -2, 0)
    return rays.astype(np.float32), np.ascontiguousarray(np.nan_to_num(J), dtype=np.float32)
