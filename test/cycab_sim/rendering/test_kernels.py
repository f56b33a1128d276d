import numpy as np
import pytest

from cycab_sim.rendering import kernels


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
    colour = np.zeros((6, 3), np.float32)
    kernels.merge_samples(np.arange(24, dtype=np.float32).reshape(8, 3), np.array([1, 4]), 2, colour)
    np.testing.assert_allclose(colour[[1, 4]], [[4.5, 5.5, 6.5], [16.5, 17.5, 18.5]])
    assert not colour[[0, 2, 3, 5]].any()


def test_tone_is_the_curve_and_grey_its_luma(rng):
    curve = (255.0 * np.linspace(0, 1, 4096) ** (1 / 2.2)).astype(np.float32)
    light = rng.uniform(0.02, 1.4, (50, 3)).astype(np.float32)
    colour, grey = np.empty((50, 3), np.float32), np.empty((50, 1), np.float32)
    kernels.tone(light, np.full(3, 0.8), curve, colour)
    kernels.tone(light, np.full(3, 0.8), curve, grey)
    np.testing.assert_allclose(colour, 255.0 * np.minimum(0.8 * light, 1.0) ** (1 / 2.2), atol=0.05)
    np.testing.assert_allclose(grey[:, 0], colour @ [0.299, 0.587, 0.114], atol=1e-3)


@pytest.mark.parametrize(("depth", "expected"), [(4.0, 1.0), (6.0, 0.0)])
def test_a_point_is_lit_in_front_of_what_the_sun_meets(depth, expected):
    shadow = np.full((4, 4), 5.0, np.float32)
    assert kernels._lit(shadow, 1.5, 1.5, depth, 0.1) == expected
    assert kernels._lit(shadow, 1.5, 1.5, depth, 2.0) == expected
    assert kernels._lit(shadow, 9.0, 1.5, depth, 0.1) == 1.0  # beyond the map


def test_the_edge_of_a_shadow_is_a_ramp():
    shadow = np.array([[5.0, 5.0, 9.0, 9.0]] * 4, np.float32)
    assert [kernels._lit_once(shadow, a, 1.0, 7.0) for a in (1.0, 1.25, 1.75, 2.0)] == [0.0, 0.25, 0.75, 1.0]
