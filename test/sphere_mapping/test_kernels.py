import numpy as np

from sphere_mapping import kernels


def test_inverse_depth_of_a_plane_is_sampled_exactly_and_edges_are_not_mixed():
    v, u = np.mgrid[0:6, 0:8].astype(np.float32)
    inverse = 0.5 + 0.003 * u - 0.002 * v
    inverse[:, 5:] = 0.1
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.5, 7.49, 500).astype(np.float32), rng.uniform(-0.5, 5.49, 500).astype(np.float32)
    sampled = np.empty(500, dtype=np.float32)
    kernels.sample_inverse_depth(inverse, x, y, 0.05, sampled)
    inner = (x >= 0) & (x <= 4) & (y >= 0) & (y <= 5)
    np.testing.assert_allclose(sampled[inner], (0.5 + 0.003 * x - 0.002 * y)[inner], rtol=1e-5)
    edge = (x > 4) & (x < 5)
    nearest = inverse[np.clip((y[edge] + 0.5).astype(int), 0, 5), (x[edge] + 0.5).astype(int)]
    np.testing.assert_array_equal(sampled[edge], nearest)


def test_outside_and_next_to_unknown_pixels():
    inverse = np.full((4, 4), 0.5, dtype=np.float32)
    inverse[1, 1] = np.nan
    x = np.float32([-0.6, 3.6, np.nan, 1.2, 1.6, 3.4])
    y = np.float32([1.0, 1.0, 1.0, 1.2, 1.0, 3.4])
    sampled = np.empty(6, dtype=np.float32)
    kernels.sample_inverse_depth(inverse, x, y, 0.05, sampled)
    np.testing.assert_array_equal(sampled, np.float32([np.nan, np.nan, np.nan, np.nan, 0.5, 0.5]))


def test_splatting_keeps_the_nearest_and_wraps_only_on_request():
    u, v = np.float32([1.3, 1.4, 3.5, np.nan]), np.float32([1.0, 1.2, 0.0, 1.0])
    range_m = np.float32([5.0, 2.0, 3.0, 1.0])
    for wraps in (False, True):
        image = np.full((3, 4), np.inf, dtype=np.float32)
        kernels.splat_nearest(u, v, range_m, wraps, image)
        np.testing.assert_array_equal(image[1:3, 1:3], 2.0)
        assert image[0, 3] == 3.0
        assert image[0, 0] == (3.0 if wraps else np.inf)
