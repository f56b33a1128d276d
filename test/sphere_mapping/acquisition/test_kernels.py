"""Kernels against the same in NumPy."""

import cv2
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


@pytest.mark.parametrize("wraps", [True])
def test_steps_of_a_pixels_own_surface_are_compared_in_both_images(wraps):
    rng = np.random.default_rng(8)
    height, width, margin = 24, 30, 2
    top, bottom = rng.integers(100, 130, (2, height, width)).astype(np.uint8)
    disparity = rng.uniform(-3, 6, (height, width)).astype(np.float32)
    disparity[5, 7] = np.nan
    products = np.empty((3, height, width + 2 * margin), np.float32)
    kernels.compare_steps(top, bottom, disparity, margin, wraps, products)
    lower, expected = bottom.astype(float), np.zeros((3, height, width))
    for v, u in np.ndindex(height, width):
        y = v - disparity[v, u]
        if 1 <= v < height - 1 and 1 <= y < height - 2:
            below = np.interp([y - 1, y, y + 1], np.arange(height), lower[:, u])
            here, there = (steady(np.diff(line)) for line in (top[v - 1 : v + 2, u].astype(float), below))
            expected[:, v, u] = here * here, there * there, here * there
    beside = {"mode": "wrap"} if wraps else {"mode": "constant"}
    expected = np.pad(expected, ((0, 0), (0, 0), (margin, margin)), **beside)
    np.testing.assert_allclose(products, expected, atol=2e-3)
    levels = np.pad(top.astype(np.float32), ((0, 0), (margin, margin)), mode="wrap")
    found = np.empty((height, width), np.float32)
    kernels.correlate_alike(levels, products, margin, np.float32(8.0), np.float32(1.0), found)
    for v, u in np.ndindex(height, width):
        rows, columns = slice(max(v - margin, 0), v + margin + 1), slice(u, u + 2 * margin + 1)
        is_alike = np.abs(levels[rows, columns] - levels[v, u + margin]) <= 8
        a, b, c = (expected[k, rows, columns][is_alike].sum() for k in range(3))
        assert found[v, u] == pytest.approx(c / np.sqrt(a * b + 1), abs=1e-3)
    assert found.min() < -0.3
    assert found.max() > 0.3


def steady(steps):
    return np.sign(steps[0]) * np.abs(steps).min() if steps[0] * steps[1] > 0 else 0.0


def test_only_what_stays_near_its_match_and_fits_is_trusted():
    refined = np.array([[1.0, 3.0, 1.0, 1.0, np.nan]], np.float32)
    start, information = np.ones_like(refined), np.array([[4.0, 4.0, 4.0, 0.0, 4.0]], np.float32)
    left, slopes = np.array([[0.5, 0.5, 1.5, 0.5, 0.5]], np.float32), np.full((2, 1, 5), 9.0, np.float32)
    value, std = np.empty_like(refined), np.empty_like(refined)
    kernels.settle(refined, start, information, left, slopes, np.float32([1.6, 1.0, 2.0, 0.25]), value, std)
    np.testing.assert_array_equal(np.isnan(value[0]), [False, True, True, True, True])
    assert std[0, 0] == pytest.approx(1.0)  # 2 / 4 + 0.25 (1 + 9 / 9)


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


def test_pixels_by_range_are_linear_between_the_tables_entries():
    rng = np.random.default_rng(4)
    levels = np.array([0.0, 0.5, 1.0], np.float32)
    base = rng.normal(size=(3, 2)).astype(np.float32)  # (K, 2): what grows with the inverse range only
    gy, gx = np.mgrid[0:4, 0:5].astype(np.float32) * 8
    grid = np.stack([np.stack([gx + base[k, 0], gy + base[k, 1]], axis=-1) for k in range(3)], axis=2)
    grid = np.ascontiguousarray(grid, dtype=np.float32)
    inverse = rng.uniform(0, 1, (30, 40)).astype(np.float32)
    u, v = (np.empty((24, 32), np.float32) for _ in range(2))
    kernels.warp_by_range(grid, levels, 8, inverse, 3, 20, 0, 0, u, v)
    rows, columns = np.mgrid[0:24, 0:32]
    w = inverse[3 + rows, (20 + columns) % 40]
    np.testing.assert_allclose(u, columns + np.interp(w, levels, base[:, 0]), atol=1e-4)
    np.testing.assert_allclose(v, rows + np.interp(w, levels, base[:, 1]), atol=1e-4)
    part = [np.empty((8, 16), np.float32) for _ in range(2)]
    kernels.warp_by_range(grid, levels, 8, inverse, 3, 20, 16, 8, *part)
    np.testing.assert_array_equal(part, [u[16:, 8:24], v[16:, 8:24]])


@pytest.mark.parametrize("channels", [3])
def test_levels_are_changed_as_by_an_image_of_factors(channels):
    rng = np.random.default_rng(5)
    part = rng.integers(1, 256, (32, 40 * channels), np.uint8)
    factor = rng.uniform(0.001, 1.5, (4, 5, channels)).astype(np.float32)
    wide = cv2.resize(factor, (40, 32), interpolation=cv2.INTER_LINEAR).reshape(part.shape)
    expected = np.maximum(cv2.multiply(part, wide, dtype=cv2.CV_8U), 1)
    for place in ((0, 0, 32, 40), (8, 16, 16, 8), (24, 32, 8, 8)):
        changed = part.copy()
        kernels.change_levels(changed, factor, 8, *place)
        rows, columns = (
            slice(place[0], place[0] + place[2]),
            slice(place[1] * channels, (place[1] + place[3]) * channels),
        )
        off = np.abs(changed[rows, columns].astype(int) - expected[rows, columns])
        assert off.max() <= 1
        assert off.mean() < 0.002  # halves are rounded either way
        changed[rows, columns] = part[rows, columns]
        np.testing.assert_array_equal(changed, part)


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


def test_splatting_keeps_the_nearest_and_wraps_only_on_request():
    u, v = np.float32([1.3, 1.4, 3.5, np.nan]), np.float32([1.0, 1.2, 0.0, 1.0])
    range_m = np.float32([5.0, 2.0, 3.0, 1.0])
    for wraps in (False, True):
        image = np.full((3, 4), np.inf, dtype=np.float32)
        kernels.splat_nearest(u, v, range_m, wraps, image)
        np.testing.assert_array_equal(image[1:3, 1:3], 2.0)
        assert image[0, 3] == 3.0
        assert image[0, 0] == (3.0 if wraps else np.inf)


def random_levels(shape, seed):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def some_unknown(shape, seed, low, high, share=0.1):
    rng = np.random.default_rng(seed)
    plane = rng.uniform(low, high, shape).astype(np.float32)
    plane[rng.random(shape) < share] = np.nan
    return plane


def test_bands_add_up_to_the_levels_of_numpy():
    """Two bands of two views with weights that sum to one, in sixteenths of a grey level."""
    views, smooth = [random_levels((6, 9, 3), seed) for seed in (0, 1)], random_levels((6, 9, 3), 2)
    weight = np.random.default_rng(3).random((6, 9)).astype(np.float32)
    weight[2] = 0.0
    total, twin = np.zeros((6, 9, 3), np.int16), np.zeros((6, 9, 3))
    for view, share in zip(views, (weight, 1 - weight), strict=True):
        kernels.add_band(view, smooth, share, total)
        twin += np.floor(16 * share[..., None] * (view.astype(np.float32) - smooth) + np.float32(0.5))
    np.testing.assert_array_equal(total, twin)
    total += 16 * smooth.astype(np.int16)
    image = np.empty((6, 9, 3), np.uint8)
    kernels.to_levels(total, image)
    np.testing.assert_array_equal(image, np.clip(np.floor(total / 16 + 0.5), 1, 255))


def test_a_step_of_alignment_is_that_of_least_squares():
    """The mean of what the slopes say and what the match says, each by its information (step_row's formulas)."""
    rng = np.random.default_rng(7)
    s, e = rng.normal(0, 80, (2, 30, 49)).round()
    sums = np.stack([np.full_like(s, 1), s, e, s * s, s * e, e * e]).sum(axis=2).astype(np.int32)
    sums[:, 3] = 0
    limits = np.float32([0.2, 20.0, 12.0, 0.25])  # px, pixels of a block, grey levels^2, px^2
    limit, _, noise, prior = limits
    start, before = (rng.normal(5, 0.5, 30).astype(np.float32) for _ in range(2))
    disparity, information, left = before.copy(), np.empty(30, np.float32), np.empty(30, np.float32)
    kernels.step_row(sums, limits, start, disparity, information, left)
    slopes, errors = s / 16, e / 16
    variance = slopes.var(axis=1)
    covariance = ((slopes - slopes.mean(axis=1, keepdims=True)) * errors).mean(axis=1)
    wanted, seen = covariance / variance, variance * 49 / 2 / noise
    step = (seen * wanted + (start - before) / prior) / (seen + 1 / prior)
    residual = (errors.var(axis=1) - covariance**2 / variance) / 2
    known = np.arange(30) != 3
    np.testing.assert_allclose(disparity[known], (before + np.clip(step, -limit, limit))[known], rtol=1e-4)
    np.testing.assert_allclose(left[known], (residual / (noise + variance))[known], rtol=1e-4)
    np.testing.assert_allclose(information[known], (variance * 49 / 2 / np.maximum(residual, noise))[known], rtol=1e-4)
    assert (disparity[3], information[3], left[3]) == (before[3], 0.0, np.inf)
    assert np.abs(step[known]).min() < limit < np.abs(step[known]).max()


def test_the_surer_of_two_values_is_preferred_from_a_share_on():
    value, other = some_unknown((9, 11), 9, 1.0, 2.0), some_unknown((9, 11), 10, 3.0, 4.0)
    std, other_std = some_unknown((9, 11), 11, 0.1, 1.0, 0.0), some_unknown((9, 11), 12, 0.1, 1.0, 0.0)
    is_other = np.isnan(value) | (other_std < 0.5 * std)
    twin = np.where(is_other, other, value), np.where(is_other, other_std, std)
    kernels.prefer_surer(value, std, other, other_std, np.float32(0.5))
    np.testing.assert_array_equal(value, twin[0])
    np.testing.assert_array_equal(std, twin[1])


def test_a_longer_baseline_stretches_the_range_but_not_where_the_images_were_joined():
    range_m, std_m = some_unknown((6, 10), 13, 1.0, 40.0), some_unknown((6, 10), 14, 0.1, 1.0, 0.0)
    range_m[0, :3], range_m[1, 0] = 10.0, np.inf
    error = np.random.default_rng(15).uniform(-0.3, 0.4, (6, 10)).astype(np.float32)
    with np.errstate(invalid="ignore"):
        factor = (1 + error) / np.maximum(1 + error * range_m / 10.0, 0.1)
        factor[~(range_m < 1e9)] = 1.0
        twin = range_m * factor, std_m * factor
    shrink = np.random.default_rng(16).uniform(0.9, 1.1, (6, 10)).astype(np.float32)
    shrink[0, :3] = 1.0
    with np.errstate(invalid="ignore"):
        twin = [np.where(twin[0] < 1e9, plane * shrink, plane) for plane in twin]
    kernels.stretch(range_m, std_m, error, shrink, np.float32(0.1))
    np.testing.assert_allclose(range_m, twin[0], rtol=2e-6)
    np.testing.assert_allclose(std_m, twin[1], rtol=2e-6)
    np.testing.assert_allclose(range_m[0, :3], 10.0, rtol=1e-6)
    assert range_m[1, 0] == np.inf


@pytest.mark.parametrize("per_m", [0.125])
def test_ranges_of_a_wall_move_to_the_common_center(per_m):
    """Two cameras beside the centre see a sphere of 5 m; NumPy looks the points up by arctan2."""
    height, width = 64, 128
    azimuth = (0.5 - (np.arange(width) + 0.5) / width) * 2 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    columns, rows = (np.stack([np.sin(a), np.cos(a)]).astype(np.float32) for a in (azimuth, elevation))
    rays = np.stack(
        [
            np.outer(np.cos(elevation), np.cos(azimuth)),
            np.outer(np.cos(elevation), np.sin(azimuth)),
            np.outer(np.sin(elevation), np.ones(width)),
        ],
        axis=-1,
    )
    offsets = np.float32([[0.3, 0.1, -0.05], [-0.2, -0.25, 0.1]])
    owner = np.where(np.arange(width) < width // 2, 0, 1).astype(np.int8)[None].repeat(height, axis=0)
    owner[:, :4] = -1
    along = np.sum(rays * offsets[np.maximum(owner, 0)], axis=-1)
    square = np.sum(offsets[np.maximum(owner, 0)].astype(float) ** 2, axis=-1)
    range_m = (-along + np.sqrt(along**2 + 25.0 - square)).astype(np.float32)  # of |offset + r ray| = 5 m
    range_m[10, 50:60], range_m[20, 50:60] = np.nan, np.inf
    std_m = np.arange(height * width, dtype=np.float32).reshape(height, width)
    found, found_std = np.empty_like(range_m), np.empty_like(std_m)
    kernels.recenter(range_m, std_m, owner, offsets, columns, rows, np.float32(per_m), found, found_std)
    with np.errstate(invalid="ignore"):
        reach = (range_m + along)[..., None]
        q = reach * rays - (1.0 - reach * per_m) * offsets[np.maximum(owner, 0)]
        u = (0.5 - np.arctan2(q[..., 1], q[..., 0]) / (2 * np.pi)) * width - 0.5
        v = (0.5 - np.arctan2(q[..., 2], np.hypot(q[..., 0], q[..., 1])) / np.pi) * height - 0.5
        row, column = (np.nan_to_num(np.floor(place + 0.5)).astype(int) for place in (v, u))
        at = row.clip(0, height - 1), column % width
    is_moved = (owner >= 0) & np.isfinite(range_m) & np.isfinite(range_m[at])
    on_edge = (np.abs(u % 1 - 0.5) < 1e-3) | (np.abs(v % 1 - 0.5) < 1e-3)  # rounded either way
    sure = is_moved & ~on_edge
    np.testing.assert_allclose(found[sure], (range_m[at] + along)[sure], rtol=1e-6)
    np.testing.assert_array_equal(found_std[sure], std_m[at][sure])
    assert np.isnan(found[owner < 0]).all()
    assert np.isnan(found[10, 50:60]).all()
    assert np.isposinf(found[20, 50:60]).all()
    is_same = is_moved & (owner[at] == owner)  # over the seam it is the other camera's range
    assert np.abs(found[is_same] - 5.0).max() < 0.05  # to first order in 0.33 m / 5 m, and half a pixel
