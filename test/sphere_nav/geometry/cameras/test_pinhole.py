"""The perspective camera: against OpenCV, strong distortion, and points behind."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import Pinhole

DISTORTIONS = {
    "none": (),
    "plumb_bob": (-0.28, 0.07, 1e-3, -5e-4, 0.02),
    "rational": (0.3, -0.05, 2e-4, 1e-4, 0.01, 0.6, -0.02, 0.02),
}


def test_project_agrees_with_opencv():
    for name in DISTORTIONS:
        camera = Pinhole(640, 480, 525.0, 520.0, 319.5, 239.0, DISTORTIONS[name])
        rng = np.random.default_rng(0)
        points = rng.uniform((-0.6, -0.45, 1.0), (0.6, 0.45, 1.0), size=(200, 3)) * rng.uniform(1, 20, size=(200, 1))
        K = np.array([[525.0, 0, 319.5], [0, 520.0, 239.0], [0, 0, 1]])
        coefficients = np.array(DISTORTIONS[name] or (0.0,) * 4)
        expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, coefficients)[0].reshape(-1, 2)
        np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-9)


def test_points_behind_are_not_projected():
    camera = Pinhole(640, 480, 525.0, 525.0, 319.5, 239.5)
    pixels, visible = camera.project([[0.1, 0.1, -2.0], [0.1, 0.1, 0.0], [0.1, 0.1, 2.0]])
    assert visible.tolist() == [False, False, True]
    assert np.isnan(pixels[:2]).all()


def test_folding_of_strong_distortion_is_refused():
    camera = Pinhole(640, 480, 300.0, 300.0, 319.5, 239.5, (-0.3,))  # r (1 - 0.3 r^2) turns back at r = 1.054
    assert camera.max_radius == pytest.approx(1 / np.sqrt(0.9), abs=6e-3)  # two steps of the scan
    radius = np.array([0.5, 1.0, 1.2, 1.6, 1.8])
    pixels, visible = camera.project(np.stack([radius, 0 * radius, 1 + 0 * radius], axis=-1))
    assert visible.tolist() == [True, True, False, False, False]  # without the check 1.6 would land inside again
    assert np.isnan(pixels[2:]).all()
