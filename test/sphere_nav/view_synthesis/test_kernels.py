"""Each kernel against a few lines of NumPy, or a law."""

import numpy as np

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.photometric.align.projection import kernel_camera, kernel_motion
from sphere_nav.view_synthesis import kernels

F = np.float32


def breaks_of(nearness, wraps=False):
    breaks = np.zeros(nearness.shape, np.uint8)
    kernels.find_breaks(nearness.astype(F), wraps, F(0.03), F(0.004), breaks)
    return breaks


def test_a_step_is_a_break_a_slope_or_a_crease_is_none_and_a_thin_thing_has_two():
    row = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.45, 0.40, 0.35, 0.30])
    assert breaks_of(np.tile(row, (3, 1)))[1].tolist() == [0, 0, 1, 0, 0, 0, 0, 0, 0, 0]
    assert breaks_of(np.tile(row, (3, 1)).T)[:, 1].tolist() == [0, 0, 2, 0, 0, 0, 0, 0, 0, 0]
    crease = np.array([0.5, 0.5, 0.5, 0.45, 0.38, 0.31, 0.24])
    assert not breaks_of(np.tile(crease, (3, 1)))[1].any()
    thin = np.array([0.5, 0.5, 0.5, 1.0, 0.5, 0.5, 0.5])
    assert breaks_of(np.tile(thin, (3, 1)))[1].tolist() == [0, 0, 1, 1, 0, 0, 0]


def test_quads_cover_what_has_no_break_once(rng):
    for wraps in [False, True]:
        nearness = np.full((20, 40), 0.5, F)
        nearness[5:9, 10:14] = 1.0
        nearness[rng.random(nearness.shape) < 0.02] = np.nan
        breaks = breaks_of(nearness, wraps)
        quads = np.empty((nearness.size, 3), np.int32)
        quads = quads[: kernels.cut_quads(nearness, breaks, wraps, 8, F(0.003), F(5e-4), quads)]
        covered = np.zeros(nearness.shape, int)
        for v, u, size in quads:
            assert u + size <= (40 if wraps else 39)
            covered[v : v + size, u : u + size] += 1
        right = np.roll(nearness, -1, axis=1)
        corners = np.stack([nearness[:-1], right[:-1], nearness[1:], right[1:]])
        expected = (np.ptp(corners, axis=0) == 0).astype(int)  # false for NaN
        assert np.array_equal(covered[:-1] if wraps else covered[:-1, :-1], expected if wraps else expected[:, :-1])
        assert quads[:, 2].max() == 8


def test_a_plane_makes_large_quads_and_waves_small_ones():
    v, u = np.mgrid[0:17, 0:17]
    for nearness, sizes in [(0.5 + 0.01 * u + 0.02 * v, {8}), (0.5 + 0.01 * np.sin(u + v), {1})]:
        quads = np.empty((nearness.size, 3), np.int32)
        breaks = np.zeros(nearness.shape, np.uint8)
        count = kernels.cut_quads(nearness.astype(F), breaks, False, 8, F(0.003), F(5e-4), quads)
        assert set(quads[:count, 2].tolist()) == sizes


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
