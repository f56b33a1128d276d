"""Each kernel against a few lines of NumPy, or a law."""

import numpy as np

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.photometric.pixels.pyramid import kernel_camera, kernel_motion
from sphere_nav.view_synthesis import kernels

F = np.float32


def test_corners_are_projected_as_the_camera_says(rng):
    lens = Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5)
    for camera in (lens, Fisheye(64, 64, 20.0, 20.5, 31.0, 32.0), Spherical(128, 64)):
        points = rng.normal(size=(3, 600)).astype(F) * 4
        T = SE3.exp([0.1, -0.2, 0.3, 0.2, 0.1, -0.3])
        placed = np.empty((600, 3), F)
        kernels.project_corners(points, kernel_motion(T.matrix), kernel_camera(camera), placed)
        moved = T.apply(points.T)
        pixels, inside = camera.project(moved)
        assert np.abs(placed[inside, :2] - pixels[inside]).max() < 2e-3
        assert np.allclose(placed[inside, 2], 1.0 / np.linalg.norm(moved[inside], axis=1), rtol=1e-5)


def test_a_triangle_from_behind_is_not_drawn():
    placed = np.array([[9.9, 9.9, 0.5], [20.1, 9.9, 0.5], [20.1, 20.1, 0.5], [9.9, 20.1, 0.5]], F)
    pixels = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], F)
    drawn = []
    for corners in ([[0, 1, 2, 3]], [[3, 2, 1, 0]]):
        nearness, source = np.zeros((32, 32), F), np.zeros((32, 32, 2), F)
        kernels.draw_quads(np.array(corners, np.int32), placed, pixels, 64, False, nearness, source)
        drawn.append((nearness, source))
    assert np.allclose(drawn[0][0][10:21, 10:21], 0.5)
    assert (drawn[0][0] > 0).sum() == 121
    assert np.allclose(drawn[0][1][15, 10:21, 0], (np.arange(10, 21) - 9.9) / 10.2, atol=1e-5)
    assert not drawn[1][0].any()


def test_quads_smaller_than_a_pixel_are_drawn_where_they_hold_one():
    side, shape = 0.375, (6, 9)
    rows, columns = np.mgrid[0:17, 0:25]
    v, u = (side * rows.ravel() - 0.4).astype(np.float32), (side * columns.ravel() - 0.4).astype(np.float32)
    placed = np.stack([u, v, np.ones_like(u)], axis=1)
    pixels = np.stack([rows.ravel(), columns.ravel()], axis=1).astype(np.float32)
    first = (25 * np.arange(16)[:, None] + np.arange(24)).ravel()
    corners = np.stack([first, first + 1, first + 26, first + 25], axis=1).astype(np.int32)
    nearness, source = np.zeros(shape, np.float32), np.full((*shape, 2), np.nan, np.float32)
    kernels.draw_quads(corners, placed, pixels, 1000, False, nearness, source)
    np.testing.assert_allclose(nearness, 1.0, rtol=1e-5)
    v, u = np.mgrid[0:6, 0:9]
    np.testing.assert_allclose(source, np.stack([(u + 0.4) / side, (v + 0.4) / side], axis=-1), atol=1e-4)
