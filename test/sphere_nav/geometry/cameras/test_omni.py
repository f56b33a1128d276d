"""Mei's camera beside the laws of `test_camera.py`: against other models, and at its limits."""

import numpy as np

from sphere_nav.geometry import DoubleSphere, Omni, Pinhole


def test_without_xi_it_is_a_pinhole_and_without_distortion_a_unified_camera():
    points, k = np.random.default_rng(0).normal(size=(500, 3)), (-0.2, 0.05, 1e-3, -5e-4)
    pinhole, omni = Pinhole(640, 480, 300.0, 290.0, 319.5, 239.5, k), Omni(640, 480, 300.0, 290.0, 319.5, 239.5, 0.0, k)
    np.testing.assert_array_equal(omni.project(points)[1], pinhole.project(points)[1])
    np.testing.assert_allclose(omni.project(points)[0], pinhole.project(points)[0], atol=1e-9)
    unified = DoubleSphere(640, 480, 300.0 / 1.8, 290.0 / 1.8, 319.5, 239.5, 0.0, 0.8 / 1.8)
    found, seen = Omni(640, 480, 300.0, 290.0, 319.5, 239.5, 0.8).project(points)
    np.testing.assert_array_equal(seen, unified.project(points)[1])
    np.testing.assert_allclose(found[seen], unified.project(points)[0][seen], atol=1e-9)


def test_the_radius_grows_with_the_angle_up_to_the_limit():
    for xi in [0.5, 1.0, 2.0]:
        camera = Omni(8000, 8000, 200.0, 200.0, 4000.0, 4000.0, xi)
        limit = np.arccos(camera.min_cosine)
        angle = np.linspace(0.0, limit - 0.1, 500)
        pixels, _ = camera.project(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1))
        assert np.all(np.diff(pixels[:, 0]) > 0)
        assert not camera.project([np.sin(limit + 1e-3), 0.0, np.cos(limit + 1e-3)])[1]


def test_pixels_beyond_the_rim_of_the_sphere_have_no_ray():
    camera = Omni(640, 480, 200.0, 200.0, 320.0, 240.0, 2.0)
    rim = 200.0 / np.sqrt(3.0)
    rays = camera.unproject([[320.0 + rim - 0.01, 240.0], [320.0 + rim + 0.01, 240.0]])
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]
