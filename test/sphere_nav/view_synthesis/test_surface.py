"""What a sphere saw, as quads."""

import numpy as np

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.surface import surface_of

CAMERA = Spherical(128, 64)


def test_corners_lie_where_the_sphere_measured(room):
    sphere = room.sphere(SE3.identity(), CAMERA)
    surface = surface_of(sphere)
    v, u = np.rint(surface.pixels.T).astype(int).clip(0, 63 + 64 * np.array([[0], [1]]))
    assert np.allclose(np.linalg.norm(surface.points, axis=0), sphere.range_m[v, u], rtol=1e-3)
    pixels, _ = CAMERA.project(surface.points.T)
    is_pole = (surface.pixels[:, 0] < 0) | (surface.pixels[:, 0] > 63)
    assert np.allclose(pixels[~is_pole], np.stack([u, v], axis=1)[~is_pole], atol=1e-3)
    assert np.allclose(pixels[is_pole, 1], surface.pixels[is_pole, 0], atol=1e-2)
    assert surface.corners.max() == surface.points.shape[1] - 1
    assert surface.num_bytes > surface.image.nbytes


def test_unknown_pixels_are_in_no_quad_and_the_sky_is_far():
    range_m = np.full((64, 128), 5.0, np.float32)
    range_m[:20], range_m[30:40, 50:60] = np.inf, np.nan
    surface = surface_of(Sphere(np.full((64, 128), 7, np.uint8), range_m, CAMERA))
    v, u = surface.pixels.T.astype(int)
    assert not np.isnan(surface.points).any()
    assert not np.isnan(range_m[v, u]).any()
    assert np.linalg.norm(surface.points, axis=0).max() > 1e5
    rows = surface.pixels[surface.corners, 0]
    assert not ((rows.min(axis=1) < 20) & (rows.max(axis=1) >= 20)).any()  # no sheet from the sky to the wall
    assert surface.image.shape == (64, 128, 3)
