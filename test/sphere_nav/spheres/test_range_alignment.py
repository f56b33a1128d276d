"""Ranges against ranges: motions come back, whatever the light; what does not hold is refused."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.range_alignment import RangeImage, align_ranges, measure_motion_by_ranges
from sphere_nav.spheres.sphere import Sphere
from worlds.room import Room, sharp_room

WHOLE = Spherical(256, 128)
WINDOW = Spherical(160, 110, 512.0, 176.0, 60.0)
T_A, T_B = SE3.from_planar(0.3, 0.2, 0.4), SE3.from_planar(0.6, -0.1, 0.55)
T_A_B = T_A.inverse() @ T_B


def ranges(pose, camera=WHOLE, room=None, noise=0.0):
    sphere = (room or sharp_room()).sphere(pose, camera)
    rng = np.random.default_rng(3)
    rough = sphere.range_m * (1.0 + noise * rng.normal(size=sphere.range_m.shape))
    dark = np.ones_like(sphere.image)  # light plays no part
    return RangeImage.from_sphere(Sphere(dark, rough.astype(np.float32), camera))


@pytest.mark.parametrize(
    ("camera", "noise", "limit_mm"), [(WHOLE, 0.0, 3.0), (WHOLE, 0.005, 6.0), (WINDOW, 0.005, 12.0)]
)
def test_a_motion_is_found_from_afar(camera, noise, limit_mm):
    guess = T_A_B @ SE3.exp([0.15, -0.1, 0.08, 0.03, -0.04, 0.1])
    fit = measure_motion_by_ranges(ranges(T_A, camera, noise=noise), ranges(T_B, camera, noise=noise), guess)
    distance, angle = T_A_B.distance(fit.T_a_b)
    assert 1e3 * distance < limit_mm
    assert angle < np.radians(0.3)
    sigma_m = np.sqrt(np.trace(fit.covariance[:3, :3]) / 3)
    assert distance < 4.0 * sigma_m < 0.05  # it knows how good it is


def test_another_geometry_is_refused():
    other = ranges(T_B, room=sharp_room((2.0, 5.0, 1.2)))
    assert measure_motion_by_ranges(ranges(T_A), other, T_A_B) is None


def test_a_single_wall_holds_no_motion():
    """It could be slid along: not observable."""
    rays = pixel_rays(WINDOW)
    wall = Sphere(np.ones(rays.shape[:2], np.uint8), (2.0 / rays[..., 0]).astype(np.float32), WINDOW)
    found = align_ranges(RangeImage.from_sphere(wall), RangeImage.from_sphere(wall), SE3.identity())
    assert found is None or not found.is_good


def test_what_is_not_measured_plays_no_part():
    camera = WHOLE
    sphere = sharp_room().sphere(T_B, camera)
    holes = sphere.range_m.copy()
    holes[:, 40:110], holes[60:] = np.nan, np.inf
    fit = align_ranges(ranges(T_A), RangeImage.from_sphere(replace(sphere, range_m=holes)), T_A_B @ SE3.exp([0.05] * 6))
    assert T_A_B.distance(fit.T_a_b)[0] < 0.005


def test_nothing_in_common_is_nothing():
    turned = Room().sphere(SE3.from_planar(0.0, 0.0, np.pi), WINDOW)
    assert (
        align_ranges(ranges(SE3.identity(), WINDOW), RangeImage.from_sphere(turned), SE3.from_planar(0, 0, np.pi))
        is None
    )
