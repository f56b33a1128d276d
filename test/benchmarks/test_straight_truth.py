"""What a rolling shutter does to a pose by a global one is taken away again."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from benchmarks.real.straight_truth import fit_at_once, twist_of
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling

CAMERA = Pinhole(640, 480, 525.0, 525.0, 320.0, 240.0)


def points(rng, num=800):
    pixels = rng.uniform([5, 5], [634, 474], (num, 2))
    rays = CAMERA.unproject(pixels)
    return rays / rays[:, 2:] * rng.uniform(1.5, 3.5, (num, 1))


def test_without_motion_nothing_changes():
    found = fit_at_once(CAMERA, points(np.random.default_rng(0)), np.zeros(6))
    np.testing.assert_allclose(found.matrix, np.eye(4), atol=1e-9)


def test_a_pan_looks_like_a_roll():
    pan = np.array([0, 0, 0, 0, 0.01, 0.0])  # 0.57 deg within the readout: rows shear by 5.2 px in 480
    rolled = fit_at_once(CAMERA, points(np.random.default_rng(1)), pan).log()
    # of a shear s of x by y the best turn is s mean(y^2) / mean(x^2 + y^2) where pixels are spread evenly
    assert abs(rolled[5]) == pytest.approx(0.01 * 525 / 480 * 480**2 / (640**2 + 480**2), rel=0.35)
    assert np.linalg.norm(rolled[3:5]) < 0.002
    back = fit_at_once(CAMERA, points(np.random.default_rng(1)), -pan).log()
    np.testing.assert_allclose(back, -rolled, atol=3e-4)


def test_the_fit_is_the_least_of_its_residual():
    rng = np.random.default_rng(2)
    p, twist = points(rng), np.array([0.005, -0.004, 0.003, 0.004, 0.006, -0.005])
    found = fit_at_once(CAMERA, p, twist)
    pixels, is_seen = project_rolling(CAMERA, p, twist)

    def cost(T):
        return np.sum((CAMERA.project(T.inverse().apply(p[is_seen]))[0] - pixels[is_seen]) ** 2)

    assert cost(found) < 0.8 * cost(SE3.identity())
    for direction in np.eye(6):
        for step in (-1e-3, 1e-3):
            assert cost(found @ SE3.exp(step * direction)) > cost(found)


def test_the_motion_within_a_readout():
    twist = np.array([0.1, 0, 0.2, 0.05, -0.1, 0.02])  # a second
    stamps = np.array([0, 100_000_000, 200_000_000])
    poses = SE3.exp(np.array([-0.1, 0.0, 0.1])[:, None] * twist)
    np.testing.assert_allclose(twist_of(stamps, poses, 1, 0.02), 0.02 * twist, atol=1e-9)
    np.testing.assert_allclose(twist_of(stamps, poses, 0, 0.02), 0.02 * twist, atol=1e-9)
