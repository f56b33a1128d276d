"""The polynomial camera beside the laws of `test_camera.py`: by its definition, and at its limits."""

import numpy as np

from sphere_nav.geometry import DoubleSphere, OCam, Pinhole
from sphere_nav.geometry.cameras.omni import Omni

H = (220.0, 0.0, -1.1e-3, 1.2e-6, -3.0e-9)


def test_a_constant_polynomial_is_a_pinhole():
    ocam, pinhole = OCam(640, 480, 319.5, 239.5, (300.0,)), Pinhole(640, 480, 300.0, 300.0, 319.5, 239.5)
    points = np.random.default_rng(0).normal((0, 0, 2), 1.0, size=(500, 3))
    seen = pinhole.project(points)[1]
    np.testing.assert_allclose(ocam.project(points)[0][seen], pinhole.project(points)[0][seen], atol=1e-9)


def test_a_ray_is_what_the_polynomial_and_the_affine_part_say():
    camera = OCam(640, 480, 320.0, 240.0, H, 0.98, 0.01, -0.02)
    q = np.array([60.0, -80.0])
    pixel = [320.0 + q[0] - 0.02 * q[1], 240.0 + 0.01 * q[0] + 0.98 * q[1]]
    ray = np.array([*q, 220.0 - 1.1e-3 * 1e4 + 1.2 - 3.0e-9 * 1e8])
    np.testing.assert_allclose(camera.unproject(pixel), ray / np.linalg.norm(ray))
    np.testing.assert_allclose(camera.project(3.0 * ray)[0], pixel)


def test_where_the_polynomial_folds_back_no_pixel_has_a_ray():
    camera = OCam(1000, 1000, 500.0, 500.0, (100.0, 0.0, 5e-3))  # atan(r / h) falls from r = sqrt(20,000) on
    rays = camera.unproject([[500.0 + 135.0, 500.0], [500.0 + 148.0, 500.0]])
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]
    beyond = camera.max_angle + 1e-3
    assert not camera.project([np.sin(beyond), 0.0, np.cos(beyond)])[1]
    assert not camera.project([0.0, 0.0, -1.0])[1]


def test_it_is_a_pinhole_that_looks_at_a_sphere_and_without_distortion_a_unified_camera():
    points, k = np.random.default_rng(0).normal(size=(500, 3)), (-0.2, 0.05, 1e-3, -5e-4, 0.01)
    pinhole = Pinhole(640, 480, 300.0, 290.0, 319.5, 239.5, k)
    for xi in (0.0, 0.9):
        omni = Omni(640, 480, 300.0, 290.0, 319.5, 239.5, xi, k)
        shifted = points + xi * np.linalg.norm(points, axis=1, keepdims=True) * [0, 0, 1]  # Mei's x / (z + xi d)
        is_near = points[:, 2] > 0.0
        np.testing.assert_array_equal(omni.project(points)[1][is_near], pinhole.project(shifted)[1][is_near])
        np.testing.assert_allclose(omni.project(points)[0][is_near], pinhole.project(shifted)[0][is_near], atol=1e-9)
    unified = DoubleSphere(640, 480, 300.0 / 1.8, 290.0 / 1.8, 319.5, 239.5, 0.0, 0.8 / 1.8)
    found, seen = Omni(640, 480, 300.0, 290.0, 319.5, 239.5, 0.8).project(points)
    np.testing.assert_array_equal(seen, unified.project(points)[1])
    np.testing.assert_allclose(found[seen], unified.project(points)[0][seen], atol=1e-9)


def test_the_radius_grows_with_the_angle_up_to_the_limit_and_beyond_no_pixel_has_a_ray():
    for xi in [0.5, 1.0, 2.0]:
        camera = Omni(8000, 8000, 200.0, 200.0, 4000.0, 4000.0, xi)
        limit = np.arccos(camera.min_cosine)
        angle = np.linspace(0.0, limit - 0.1, 500)
        pixels, _ = camera.project(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1))
        assert np.all(np.diff(pixels[:, 0]) > 0)
        assert not camera.project([np.sin(limit + 1e-3), 0.0, np.cos(limit + 1e-3)])[1]
    camera = Omni(640, 480, 200.0, 200.0, 320.0, 240.0, 2.0)
    rim = 200.0 / np.sqrt(3.0)
    rays = camera.unproject([[320.0 + rim - 0.01, 240.0], [320.0 + rim + 0.01, 240.0]])
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]
