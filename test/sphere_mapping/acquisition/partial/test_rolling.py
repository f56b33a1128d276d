"""What rows read one after the other saw becomes what the camera saw at the middle row."""

from dataclasses import replace

import numpy as np

from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, roll, sphere_from_view
from sphere_mapping.acquisition.partial.window import window_of
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import optical, sharp_room

CAMERA = Pinhole(240, 180, 180.0, 180.0, 119.5, 89.5)
ROOM, PLACE = sharp_room(), SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])
TWIST = 0.68 * np.array([0.04, 0.01, 0.0, 0.005, 0.01, np.radians(1.2)])  # of the sphere, in body axes
OPTICAL_TWIST = T_BODY_OPTICAL.inverse().adjoint() @ TWIST


def rgbd(twist):
    """What the camera sees whose rows are read while it moves by the twist."""
    gray = ROOM.render_rolling(CAMERA, optical(PLACE), twist)
    range_m = ROOM.range_rolling(CAMERA, optical(PLACE), twist)
    depth_m = range_m * CAMERA.unproject(pixel_grid(CAMERA))[..., 2]
    return RgbdView(np.rint(gray).astype(np.uint8), depth_m.astype(np.float32), CAMERA)


def difference(view, other):
    """Mean difference of the grey levels, median relative one of the ranges."""
    one, two = sphere_from_view(view), sphere_from_view(other)
    both = np.isfinite(one.range_m) & np.isfinite(two.range_m)
    off = np.abs(one.image.astype(float) - two.image)[both].mean()
    return off, np.median(np.abs(one.range_m / two.range_m - 1.0)[both])


def test_pixels_of_rays_are_those_of_the_definition():
    window = window_of(CAMERA, T_BODY_OPTICAL, 1131)
    rays = window.unproject(pixel_grid(window)) @ T_BODY_OPTICAL.rotation
    pixels, _ = CAMERA.project(rays)
    u, v = np.moveaxis(np.nan_to_num(pixels, nan=-1e4).astype(np.float32), -1, 0)
    near = np.full(u.shape, 0.4, np.float32)
    rows = roll(u, v, CAMERA, T_BODY_OPTICAL, window, TWIST, near)
    expected, seen = project_rolling(CAMERA, (rays / 0.4).reshape(-1, 3), OPTICAL_TWIST)
    found = np.stack([rows.u, rows.v], axis=-1).reshape(-1, 2)
    assert np.abs(found - expected)[seen].max() < 0.05  # half of (s omega)^2 f
    assert np.linalg.norm(expected - pixels.reshape(-1, 2), axis=1)[seen].max() > 1.0


def test_a_sphere_is_straightened():
    still, moving = rgbd(0.0 * TWIST), rgbd(OPTICAL_TWIST)
    bent, straight = difference(moving, still), difference(replace(moving, twist=TWIST), still)
    assert straight[0] < 0.2 * bent[0]
    assert straight[1] < 0.25 * bent[1]
