"""What a rolling shutter does to a pose by a global one is taken away again."""

import numpy as np

from benchmarks.real.straight_truth import fit_at_once, twist_of
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling

CAMERA = Pinhole(640, 480, 525.0, 525.0, 320.0, 240.0)


def points(rng, num=800):
    pixels = rng.uniform([5, 5], [634, 474], (num, 2))
    rays = CAMERA.unproject(pixels)
    return rays / rays[:, 2:] * rng.uniform(1.5, 3.5, (num, 1))


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
