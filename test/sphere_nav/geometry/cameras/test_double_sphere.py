"""The double-sphere camera beside the laws of `test_camera.py`: against the paper's formula, and at its limits."""

from contextlib import nullcontext

import numpy as np
import pytest

from sphere_nav.geometry import DoubleSphere, Omni, Pinhole


def test_a_point_projects_as_the_paper_says():
    camera = DoubleSphere(1000, 1000, 200.0, 210.0, 500.0, 490.0, -0.2, 0.6)
    x, y, z = 1.0, -2.0, 0.5
    d1 = np.sqrt(x * x + y * y + z * z)
    d2 = np.sqrt(x * x + y * y + (-0.2 * d1 + z) ** 2)
    divisor = 0.6 * d2 + 0.4 * (-0.2 * d1 + z)
    pixels, visible = camera.project([x, y, z])
    np.testing.assert_allclose(pixels, [200 * x / divisor + 500, 210 * y / divisor + 490])
    assert visible


def test_the_radius_grows_with_the_angle_up_to_the_limit():
    for xi, alpha in [(-0.28, 0.57), (0.46, 0.77), (0.2, 0.3), (0.0, 0.5)]:
        camera = DoubleSphere(4000, 4000, 200.0, 200.0, 2000.0, 2000.0, xi, alpha)
        w1 = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
        limit = np.arccos(-w1 * (np.sqrt(1 - xi * xi * (1 - w1 * w1)) - w1 * xi) - xi)  # w1 carried to the first centre
        assert -w1 == pytest.approx(camera.min_cosine)
        angle = np.linspace(0.0, limit - 1e-3, 500)
        pixels, _ = camera.project(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1))
        assert np.all(np.diff(pixels[:, 0]) > 0)
        beyond = limit + 1e-3
        assert not camera.project([np.sin(beyond), 0.0, np.cos(beyond)])[1]


def test_pixels_outside_the_image_circle_have_no_ray():
    camera = DoubleSphere(1216, 1216, 225.0, 225.0, 607.5, 607.5, -0.28, 0.57)
    radius = 225.0 / np.sqrt(2 * 0.57 - 1)
    rays = camera.unproject([[607.5 + radius - 0.01, 607.5], [607.5 + radius + 0.01, 607.5]])
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]


def test_every_lens_up_to_the_bounds_of_its_model_can_be_told():
    for xi, alpha, is_lens in [(1.0, 0.0, 1), (-0.99, 1.0, 1), (-1.0, 0.5, 0)]:
        with nullcontext() if is_lens else pytest.raises(ValueError, match="expected -1 < xi <= 1"):
            DoubleSphere(40, 40, 20.0, 20.0, 20.0, 20.0, xi, alpha)


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
