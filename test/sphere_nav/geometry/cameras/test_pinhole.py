"""The fisheye camera: against OpenCV, beyond 90 degrees, the fold, and straight behind."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import Fisheye, Pinhole

DISTORTION = (0.02, -0.005, 0.001, -0.0002)


@pytest.mark.skipif(not hasattr(cv2, "fisheye"), reason="this OpenCV has no fisheye module")
def test_project_agrees_with_opencv():
    camera = Fisheye(1280, 1024, 330.0, 329.0, 640.0, 510.0, DISTORTION)
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.normal(size=(300, 2)), rng.uniform(0.2, 2.0, 300)])  # OpenCV: in front only
    K = np.array([[330.0, 0, 640.0], [0, 329.0, 510.0], [0, 0, 1]])
    expected = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, np.array(DISTORTION))[0]
    np.testing.assert_allclose(camera.project(points)[0], expected.reshape(-1, 2), atol=1e-9)


def test_straight_behind_is_not_visible():
    camera = Fisheye(1000, 1000, 150.0, 150.0, 499.5, 499.5)  # the direction is a whole circle of pixels
    pixels, visible = camera.project([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    assert visible.tolist() == [False, True]
    assert np.isnan(pixels[0]).all()
    np.testing.assert_allclose(pixels[1], [499.5, 499.5])
    rays = camera.unproject([[499.5 + 150.0 * 3.14, 499.5], [499.5 + 150.0 * 3.15, 499.5]])
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]


def test_folding_of_strong_distortion_and_wrong_coefficients_are_refused():
    camera = Fisheye(1000, 1000, 150.0, 150.0, 499.5, 499.5, (-0.1, 0.0, 0.0, 0.0))  # turns back at sqrt(10 / 3)
    fold = np.sqrt(10 / 3)
    assert camera.max_radius == pytest.approx(fold, abs=6e-3)  # two steps of the scan
    angle = np.array([fold - 0.1, fold + 0.1])
    visible = camera.project(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1))[1]
    assert visible.tolist() == [True, False]
    largest = fold * (1 - 0.1 * fold**2)
    rays = camera.unproject([[499.5 + 150 * (largest - 0.01), 499.5], [499.5 + 150 * (largest + 0.01), 499.5]])
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]
    unfolding = Fisheye(1000, 1000, 150.0, 150.0, 499.5, 499.5, (-0.1, 0.0044, 0.0, 0.0))  # grows again from 2.8 on
    rays = unfolding.unproject([[499.5 + 150 * 1.36, 499.5], [499.5 + 150 * 1.38, 499.5]])  # the fold: 1.369
    assert np.isfinite(rays).all(axis=-1).tolist() == [True, False]
    for distortion in [(0.1, 0.0), (0.0, 0.0, 0.0, np.inf)]:
        with pytest.raises(ValueError, match="distortion: expected 4 finite numbers"):
            Fisheye(640, 480, 300.0, 300.0, 319.5, 239.5, distortion)


def test_a_pinhole_projects_as_opencv_does():
    rational = (0.3, -0.05, 2e-4, 1e-4, 0.01, 0.6, -0.02, 0.02)
    for distortion in [(), (-0.28, 0.07, 1e-3, -5e-4, 0.02), rational]:
        camera = Pinhole(640, 480, 525.0, 520.0, 319.5, 239.0, distortion)
        rng = np.random.default_rng(0)
        points = rng.uniform((-0.6, -0.45, 1.0), (0.6, 0.45, 1.0), size=(200, 3)) * rng.uniform(1, 20, size=(200, 1))
        K = np.array([[525.0, 0, 319.5], [0, 520.0, 239.0], [0, 0, 1]])
        coefficients = np.array(distortion or (0.0,) * 4)
        expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, coefficients)[0].reshape(-1, 2)
        np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-9)


def test_a_pinhole_that_folds_back_is_cut_off_and_points_behind_are_not_projected():
    camera = Pinhole(640, 480, 300.0, 300.0, 319.5, 239.5, (-0.3,))  # r (1 - 0.3 r^2) turns back at r = 1.054
    assert camera.max_radius == pytest.approx(1 / np.sqrt(0.9), abs=6e-3)  # two steps of the scan
    radius = np.array([0.5, 1.0, 1.2, 1.6, 1.8])
    pixels, visible = camera.project(np.stack([radius, 0 * radius, 1 + 0 * radius], axis=-1))
    assert visible.tolist() == [True, True, False, False, False]  # without the check 1.6 would land inside again
    assert np.isnan(pixels[2:]).all()
    camera = Pinhole(640, 480, 525.0, 525.0, 319.5, 239.5)
    pixels, visible = camera.project([[0.1, 0.1, -2.0], [0.1, 0.1, 0.0], [0.1, 0.1, 2.0]])
    assert visible.tolist() == [False, False, True]
    assert np.isnan(pixels[:2]).all()
