import numpy as np
import pytest

from cycab_sim.rendering import kernels
from cycab_sim.world.mesh import moved, placed
from sphere_nav.geometry import SE3


def test_edges_are_where_surfaces_or_ranges_change_and_the_light_with_them():
    triangles = np.array([[0, 0, 1, 2], [0, 0, 1, 3], [-1, -1, kernels.OUTSIDE, 3]], np.int32)
    surface_of = np.array([0, 1, 1, 2], np.int32)
    normals = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [1, 0, 0]], np.float32)
    ranges = np.array([[5, 5, 6, 9], [5, 5, 6, 9], [np.inf, np.inf, np.nan, 9]], np.float32)
    levels = np.array([[1, 1, 2, 3], [1, 1, 2, 3.01], [9, 9, 0, 3]], np.float32)
    found = np.empty((3, 4), np.uint8)
    kernels.find_edges(triangles, surface_of, normals, ranges, np.repeat(levels[..., None], 3, 2), found)
    # between 2 and 3 on the right the surface changes but the light does not; OUTSIDE is no edge
    assert found.tolist() == [[0, 1, 1, 1], [1, 1, 1, 1], [1, 1, 0, 0]]


def test_rays_are_turned_as_by_the_matrix(rng):
    R = SE3.exp([0.0, 0.0, 0.0, 0.3, -1.2, 0.7]).rotation
    rays = rng.normal(size=(50, 3)).astype(np.float32)
    rays[7] = np.nan  # outside the lens
    out = np.empty_like(rays)
    kernels.turn_rays(rays, R.astype(np.float32), out)
    np.testing.assert_allclose(out, rays @ R.T, atol=2e-6)


def test_split_rays_fill_their_pixel(rng):
    u, v = np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.1, 0.1, 5))
    rays = np.stack([u, v, np.ones_like(u)], axis=-1).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    out = np.empty((4, 3), np.float32)
    kernels.split_rays(rays, np.array([2 * 9 + 4]), 2, out)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0, atol=1e-6)
    at = out[:, :2] / out[:, 2:] / 0.05  # in pixels around the middle
    np.testing.assert_allclose(at, [[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]], atol=2e-3)


def test_samples_are_averaged():
    color = np.zeros((6, 3), np.float32)
    kernels.merge_samples(np.arange(24, dtype=np.float32).reshape(8, 3), np.array([1, 4]), 2, color)
    np.testing.assert_allclose(color[[1, 4]], [[4.5, 5.5, 6.5], [16.5, 17.5, 18.5]])
    assert not color[[0, 2, 3, 5]].any()


def test_tone_is_the_curve_and_gray_its_luma(rng):
    curve = (255.0 * np.linspace(0, 1, 4096) ** (1 / 2.2)).astype(np.float32)
    light = rng.uniform(0.02, 1.4, (50, 3)).astype(np.float32)
    color, gray = np.empty((50, 3), np.float32), np.empty((50, 1), np.float32)
    kernels.tone(light, np.full(3, 0.8), curve, color)
    kernels.tone(light, np.full(3, 0.8), curve, gray)
    np.testing.assert_allclose(color, 255.0 * np.minimum(0.8 * light, 1.0) ** (1 / 2.2), atol=0.05)
    np.testing.assert_allclose(gray[:, 0], color @ [0.299, 0.587, 0.114], atol=1e-3)


@pytest.mark.parametrize(("depth", "expected"), [(4.0, 1.0), (6.0, 0.0)])
def test_a_point_is_lit_in_front_of_what_the_sun_meets(depth, expected):
    shadow = np.full((4, 4), 5.0, np.float32)
    assert kernels._lit(shadow, 1.5, 1.5, depth, 0.1) == expected
    assert kernels._lit(shadow, 1.5, 1.5, depth, 2.0) == expected
    assert kernels._lit(shadow, 9.0, 1.5, depth, 0.1) == 1.0  # beyond the map


def test_the_edge_of_a_shadow_is_a_ramp():
    shadow = np.array([[5.0, 5.0, 9.0, 9.0]] * 4, np.float32)
    assert [kernels._lit_once(shadow, a, 1.0, 7.0) for a in (1.0, 1.25, 1.75, 2.0)] == [0.0, 0.25, 0.75, 1.0]


def test_parts_are_placed_with_their_texture(rng):
    triangles = rng.normal(size=(4, 3, 3)).astype(np.float32)
    normals = rng.normal(size=(4, 3)).astype(np.float32)
    frames = rng.normal(size=(2, 3, 4)).astype(np.float32)
    poses = np.stack([placed(3.0, -2.0, 0.7, 0.5), placed(-1.0, 4.0, 2.0)])
    out = triangles.copy(), normals.copy(), frames.copy()
    kernels.place_parts(poses, np.array([0, 0, 1, 1]), np.array([0, 1]), (triangles, normals, frames), out)
    for t, part in enumerate((0, 0, 1, 1)):
        np.testing.assert_allclose(out[0][t], moved(triangles[t], poses[part]), atol=1e-5)
        np.testing.assert_allclose(out[1][t], poses[part, :3, :3] @ normals[t], atol=1e-5)
    for s in (0, 1):  # a point keeps its place in the texture
        before = frames[s, :, :3] @ triangles[2 * s, 0] + frames[s, :, 3]
        after = out[2][s, :, :3] @ out[0][2 * s, 0] + out[2][s, :, 3]
        np.testing.assert_allclose(after, before, atol=1e-5)


def test_a_shadow_is_drawn_and_taken_away():
    still = np.full((40, 40), 9.0, np.float32)
    shadow, windows = still.copy(), np.empty((1, 4), np.int32)
    triangle = np.array([[[1.0, 1.0, 4.0], [3.0, 1.0, 4.0], [1.0, 3.0, 5.0]]], np.float32)
    kernels.cast_shadows(triangle, np.eye(3), np.zeros(2), 0.1, windows, shadow)
    assert shadow[15, 15] == pytest.approx(4.25)  # row y, column x; the depth rises with y
    assert shadow[29, 29] == 9.0  # beyond the long side
    assert shadow[5, 15] == 9.0
    assert (shadow < 9.0).sum() == pytest.approx(200, rel=0.2)  # 2 m^2 in texels, and a fringe
    kernels.erase_shadows(windows, still, shadow)
    np.testing.assert_array_equal(shadow, still)


def test_what_lies_beyond_the_map_has_no_shadow_there():
    shadow, windows = np.full((20, 20), 9.0, np.float32), np.empty((2, 4), np.int32)
    triangle = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]], np.float32)
    both = np.concatenate([triangle + np.float32([50.0, 0, 0]), triangle - np.float32([0.0, 50, 0])])
    kernels.cast_shadows(both, np.eye(3), np.zeros(2), 0.1, windows, shadow)
    assert np.all(shadow == 9.0)
    kernels.erase_shadows(windows, shadow.copy(), shadow)
