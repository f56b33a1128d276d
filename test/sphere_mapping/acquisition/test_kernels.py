"""Kernels against the same in NumPy."""

import numpy as np
import pytest

from sphere_mapping.acquisition import kernels


@pytest.fixture(scope="module", autouse=True)
def compiled():
    kernels.warm_up()


def texture(rows, columns):
    """Grey levels of places; smooth, so that cubic interpolation is exact to a fraction of a level."""
    return 128 + 50 * np.sin(0.35 * rows + 0.2 * columns) + 40 * np.cos(0.21 * rows - 0.33 * columns)


def test_blocks_are_aligned_to_a_hundredth_of_a_pixel():
    rows, columns = np.mgrid[0:60, 0:50].astype(float)
    true = 4.3 + 0.02 * columns  # slanted: every column has another disparity
    top, bottom = (np.rint(texture(r, columns)).astype(np.uint8) for r in (rows - true, rows))
    start = np.rint(true).astype(np.float32)
    disparity, information, left, spare = start.copy(), *(np.empty_like(start) for _ in range(3))
    limits = np.array([0.5, 10, 1.0, 0.3**2], np.float32)
    for _ in range(4):
        kernels.align_along_columns(top, bottom, start, limits, 3, disparity, information, left)
        smoothed = np.empty_like(start)
        kernels.smooth(disparity, 3, np.float32(1.0), np.float32(0.03), spare, smoothed)
        disparity = smoothed
    inner = (slice(14, -8), slice(8, -8))
    assert np.abs(disparity - true)[inner].max() < 0.05  # rounding of grey levels, and the pull of the match
    assert np.median(np.abs(disparity - true)[inner]) < 0.01
    assert left[inner].max() < 0.1
    # two images with noise of variance 1: 1 / variance of the block is that of its slopes, and of the match
    slopes = np.gradient(texture(rows - true, columns), axis=0)[27:34, 22:29]
    expected = np.sum((slopes - slopes.mean()) ** 2) / 2 + 1 / 0.3**2
    assert information[30, 25] == pytest.approx(expected, rel=0.05)


def test_costs_are_compared_over_all_that_is_searched():
    rng = np.random.default_rng(6)
    width, height, first, radius, number = 7, 70, -2, 2, kernels.NUM_DISPARITIES
    top = rng.integers(-300, 300, (width + 2 * radius, height)).astype(np.int16)
    low = rng.integers(-300, 300, (width + 2 * radius, height + number - 1)).astype(np.int16)
    high = low + rng.integers(0, 40, low.shape).astype(np.int16)
    disparities = rng.uniform(first, first + number - 1, (2, width, height)).astype(np.float32)
    disparities[1, 3] = np.nan
    ratios = np.empty_like(disparities)
    kernels.cost_ratios(top, low, high, disparities, first, radius, ratios)
    seen = height - 1 - np.arange(height)[:, None] + np.arange(number)  # (H, D)
    level = top[:, :, None]
    outside = np.maximum(np.maximum(level - high[:, seen], low[:, seen] - level), 0)
    costs = np.minimum(outside, kernels.COST_CAP).astype(int)
    costs = sum(costs[k : k + width] for k in range(2 * radius + 1))
    rows = np.clip(np.arange(height)[:, None] + np.arange(-radius, radius + 1), 0, height - 1)
    costs = costs[:, rows].sum(axis=2) + kernels.COST_NOISE * (2 * radius + 1) ** 2
    assert np.isnan(ratios[1, 3]).all()
    for n, u, v in np.ndindex(*ratios.shape):
        if not np.isnan(disparities[n, u, v]):
            far = np.abs(np.arange(number) + first - np.floor(disparities[n, u, v] + np.float32(0.5)))
            expected = costs[u, v, far > 2].min() / costs[u, v, far <= 1].min()
            assert ratios[n, u, v] == pytest.approx(expected, rel=1e-6)


def test_only_what_stays_near_its_match_and_fits_is_trusted():
    refined = np.array([[1.0, 3.0, 1.0, 1.0, np.nan]], np.float32)
    start, information = np.ones_like(refined), np.array([[4.0, 4.0, 4.0, 0.0, 4.0]], np.float32)
    left, slopes = np.array([[0.5, 0.5, 1.5, 0.5, 0.5]], np.float32), np.full((2, 1, 5), 9.0, np.float32)
    value, std = np.empty_like(refined), np.empty_like(refined)
    kernels.settle(refined, start, information, left, slopes, np.float32([1.6, 1.0, 2.0, 0.25]), value, std)
    np.testing.assert_array_equal(np.isnan(value[0]), [False, True, True, True, True])
    assert std[0, 0] == pytest.approx(1.0)  # 2 / 4 + 0.25 (1 + 9 / 9)


def test_a_level_starts_where_the_coarser_one_has_aligned_near_its_match():
    matched, aligned = np.float32([[2.0, np.nan]]), np.float32([[4.2, 9.0, 5.0, 5.0], [np.nan, 3.9, 5.0, 5.0]])
    start = np.empty_like(aligned)
    kernels.take_over(matched, aligned, np.float32(1.0), start)
    np.testing.assert_array_equal(start, np.float32([[4.2, 4.0, np.nan, np.nan], [4.0, 3.9, np.nan, np.nan]]))


def test_what_a_window_sees_from_beside_lies_where_the_centre_sees_it():
    """A wall 4 m ahead, seen from 0.2 m to the left."""
    height, width = 90, 180
    v, u = np.mgrid[30:60, 70:110].astype(np.float32)
    azimuth, elevation = (0.5 - (u + 0.5) / width) * 2 * np.pi, (0.5 - (v + 0.5) / height) * np.pi
    rays = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    rays, pixels = np.ascontiguousarray(rays, np.float32), np.ascontiguousarray(np.stack([u, v], -1))
    range_m = (4.0 / rays[..., 0]).astype(np.float32)
    range_m[0, 0] = np.inf
    nearest, places = np.full((height, width), np.inf, np.float32), np.empty((3, *v.shape), np.float32)
    kernels.place_window(range_m, rays, pixels, np.float32([0.0, 0.2, 0.0]), nearest, places)
    found, std = np.empty_like(nearest), np.empty_like(nearest)
    relative = np.full_like(range_m, 0.01)
    kernels.mean_of_window(places, relative, nearest, np.zeros((height, width, 4), np.float32), found, std)
    known = np.isfinite(found)
    assert known[33:57, 75:100].all()
    assert not known[:, :60].any()
    known[:, 100:] = False  # the rim holds what lies beside its pixels only
    known[:33], known[57:], known[:, :76] = False, False, False
    rows, columns = np.nonzero(known)
    ahead = np.cos((0.5 - (rows + 0.5) / height) * np.pi) * np.cos((0.5 - (columns + 0.5) / width) * 2 * np.pi)
    np.testing.assert_allclose(found[known] * ahead, 4.0, rtol=0.02)
    assert (std[known] >= 0.0099 * found[known]).all()


def test_unknown_disparity_stays_unknown():
    level = np.full((20, 20), 100, np.uint8)
    start = np.full((20, 20), np.nan, np.float32)
    disparity, information, left = start.copy(), np.empty_like(start), np.empty_like(start)
    kernels.align_along_columns(level, level, start, np.ones(4, np.float32), 2, disparity, information, left)
    assert np.isnan(disparity).all()
    assert (information[:, 2:-2] == 0).all()
    assert np.isinf(left[:, 2:-2]).all()


def test_smoothing_keeps_slopes_and_edges():
    rows, columns = np.mgrid[0:30, 0:40].astype(np.float32)
    plane = np.float32(10) + np.float32(0.1) * rows + np.where(columns < 20, 0, 9).astype(np.float32)
    noisy = plane + np.random.default_rng(1).normal(0, 0.2, plane.shape).astype(np.float32)
    noisy[5, 5] = np.nan
    out = np.empty_like(noisy)
    kernels.smooth(noisy, 3, np.float32(1.0), np.float32(0.03), np.empty_like(noisy), out)
    assert np.isnan(out[5, 5])
    assert np.isnan(out).sum() == 1
    inner = (slice(3, -3), slice(3, -3))
    assert np.nanstd((out - plane)[inner]) < 0.06  # 49 values, some of them too far off to be averaged


def test_fused_range_is_the_weighted_mean_unless_denied():
    def fuse(*values):
        ranges, stds = (np.array([v[k] for v in values], np.float32).reshape(-1, 1, 1) for k in (0, 1))
        out, out_std = np.empty((1, 1), np.float32), np.empty((1, 1), np.float32)
        kernels.fuse(ranges, stds, *np.float32([3.0, 3.0, 0.05]), out, out_std)
        return out[0, 0], out_std[0, 0]

    assert fuse((10.0, 0.1), (10.3, 0.2))[0] == pytest.approx(10.06)
    assert fuse((10.0, 0.1), (10.3, 0.2))[1] == pytest.approx(0.2 * 0.1 / np.hypot(0.1, 0.2))
    assert np.isnan(fuse((10.0, 0.1), (14.0, 0.2))[0])  # about as sure, and elsewhere
    assert fuse((10.0, 0.1), (14.0, 0.9))[0] == 10.0  # far less sure
    assert fuse((10.0, 0.01), (10.4, 0.02))[0] == 10.0  # differs by little
    assert np.isinf(fuse((np.inf, np.nan), (np.nan, np.nan))[0])
    assert np.isnan(fuse((np.nan, np.nan), (np.nan, np.nan))[0])


def test_range_is_that_of_the_triangle():
    rng = np.random.default_rng(3)
    height, baseline = 180, 0.4
    per_row = np.pi / height
    truth = rng.uniform(1.0, 40.0, (height, 8))
    above = ((np.arange(height) + 0.5) * per_row)[:, None]
    below = np.arctan2(truth * np.sin(above), truth * np.cos(above) + baseline)
    disparity = ((above - below) / per_row).astype(np.float32)
    std = np.full_like(disparity, 0.01)
    range_m, range_std = np.empty_like(std), np.empty_like(std)
    kernels.triangulate(disparity, std, per_row, 0.0, baseline, (0.5, 0.1, 1e6), range_m, range_std)
    known = np.isfinite(range_m)
    assert known.mean() > 0.9
    np.testing.assert_allclose(range_m[known], truth[known], rtol=2e-3)  # float32 of a small angle
    moved, ignored = np.empty_like(std), np.empty_like(std)
    kernels.triangulate(disparity + np.float32(0.001), std, per_row, 0.0, baseline, (9, 0.1, 1e6), moved, ignored)
    both = known & np.isfinite(moved) & (truth < 10)
    slope = np.abs(moved - range_m)[both] / 0.001
    np.testing.assert_allclose(range_std[both], 0.01 * slope, rtol=0.1)


def test_tangent_is_exact_where_it_is_a_series():
    for angle in (1e-4, 0.1, 0.349, 0.36, 1.0):
        assert kernels.tangent(angle) == pytest.approx(np.tan(angle), rel=2e-7)


def test_pixels_by_range_are_linear_between_the_tables_entries():
    rng = np.random.default_rng(4)
    levels = np.array([0.0, 0.5, 1.0], np.float32)
    base = rng.normal(size=(3, 2)).astype(np.float32)  # (K, 2): what grows with the inverse range only
    gy, gx = np.mgrid[0:4, 0:5].astype(np.float32) * 8
    grid = np.stack([np.stack([gx + base[k, 0], gy + base[k, 1]], axis=-1) for k in range(3)], axis=2)
    grid = np.ascontiguousarray(grid, dtype=np.float32)
    inverse = rng.uniform(0, 1, (30, 40)).astype(np.float32)
    u, v = (np.empty((24, 32), np.float32) for _ in range(2))
    kernels.warp_by_range(grid, levels, 8, inverse, 3, 20, u, v)
    rows, columns = np.mgrid[0:24, 0:32]
    w = inverse[3 + rows, (20 + columns) % 40]
    np.testing.assert_allclose(u, columns + np.interp(w, levels, base[:, 0]), atol=1e-4)
    np.testing.assert_allclose(v, rows + np.interp(w, levels, base[:, 1]), atol=1e-4)


def test_the_nearest_of_two_points_covers_a_pixel():
    nearest, std = np.full((5, 8), np.inf, np.float32), np.full((5, 8), np.nan, np.float32)
    u, v = np.array([7.4, 7.4], np.float32), np.array([2.2, 2.2], np.float32)
    kernels.splat_with_std(
        u, v, np.array([3.0, 2.0], np.float32), np.array([0.3, 0.2], np.float32), 0, True, nearest, std
    )
    assert nearest[2, 7] == nearest[3, 0] == 2.0  # around the seam
    assert std[2, 0] == np.float32(0.2)
    assert np.isinf(nearest[2, 5])


def test_small_angles_are_exact():
    for angle in (0.001, 0.1, 0.19, 1.0, 3.0):
        assert kernels.small_angle(np.sin(angle), np.cos(angle)) == pytest.approx(angle, rel=2e-5)


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
