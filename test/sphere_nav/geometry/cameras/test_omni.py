"""Mei's camera beside the laws of `test_camera.py`: by its definition, and at its limits."""

import numpy as np

from sphere_nav.geometry import DoubleSphere, Omni, Pinhole


def test_it_is_a_pinhole_that_looks_at_a_sphere_and_without_distortion_a_unified_camera():
    points, k = np.random.default_rng(0).normal(size=(500, 3)), (-0.2, 0.05, 1e-3, -5e-4, 0.01)
    pinhole = Pinhole(640, 480, 300.0, 290.0, 319.5, 239.5, k)
    for xi in (0.0, 0.9):
        omni = Omni(640, 480, 300.0, 290.0, 319.5, 239.5, xi, k)
        shifted = points + xi * np.linalg.norm(points, axis=1, keepdims=True) * [0, 0, 1]  # Mei's x / (z + xi d)
        is_near = points[:, 2] > 0.0
        np.testing.assert_allclose(omni.project(points)[0][is_near], pinhole.project(shifted)[0][is_near], atol=1e-9)
    unified = DoubleSphere(640, 480, 300.0 / 1.8, 290.0 / 1.8, 319.5, 239.5, 0.0, 0.8 / 1.8)
    found, seen = Omni(640, 480, 300.0, 290.0, 319.5, 239.5, 0.8).project(points)
    np.testing.assert_array_equal(seen, unified.project(points)[1])
    np.testing.assert_allclose(found[seen], unified.project(points)[0][seen], atol=1e-9)


def test_the_radius_grows_with_the_angle_up_to_the_limit_and_beyond_no_pixel_has_a_ray():
    for xi in [0.5, 1.0, 2.0]:
        camera = Omni(8000, 8000, 200.0, 200.0, 4000.0, 4000.0, xi)
        limit = np.arccos(-min(xi, 1 / xi))
        angle = np.linspace(0.0, limit - 0.1, 500)
        pixels, _ = camera.project(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1))
        assert np.all(np.diff(pixels[:, 0]) > 0)
        assert not camera.project([np.sin(limit + 1e-3), 0.0, np.cos(limit + 1e-3)])[1]
    camera = Omni(640, 480, 200.0, 200.0, 320.0, 240.0, 2.0)
    rim = 200.0 / np.sqrt(3.0)
    rays = camera.unproject([[320.0 + rim - 0.01, 240.0], [320.0 + rim + 0.01, 240.0]])
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]
