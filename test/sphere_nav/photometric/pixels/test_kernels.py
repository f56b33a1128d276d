"""Each kernel beside the iteration against a few lines of NumPy."""

from itertools import pairwise

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid, pixel_rays
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.pixels import kernels
from sphere_nav.photometric.pixels.kernels import UNKNOWN
from sphere_nav.photometric.pixels.pyramid import halve, kernel_camera, kernel_motion
from sphere_nav.photometric.pixels.reference import (
    ReferenceLevel,
    curve,
    in_codes,
    in_steps,
    is_spaced,
    keep_evenly_spaced,
    kernel_rays,
)
from worlds.blocks import in_blocks

CAMERAS = [
    Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5),
    Fisheye(64, 64, 20.0, 20.5, 31.0, 32.0, (0.05, -0.06, 0.03, -0.005)),
    Spherical(40, 30, 128.0, 110.0, 12.0),
]


@pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
def test_halve_weighs_1_3_3_1_and_closes_a_whole_sphere(dtype, rng):
    for width, pad in [(16, 0), (17, 0), (16, 1)]:
        image = rng.uniform(0, 256, (12, width)).astype(dtype)
        edges = [np.pad(image, ((0, 0), (k, k)), mode="wrap") for k in (pad, 2 * pad)]
        out = halve(edges[0], pad, np.empty((6, 8 + 2 * pad), np.uint16 if dtype == np.uint16 else np.float32))
        padded = np.pad(edges[1], ((1, 1), (1 - pad, 1 - pad)), mode="edge").astype(np.float64)[:, pad:]
        padded = padded[:, : padded.shape[1] - pad]
        weights = np.outer([1, 3, 3, 1], [1, 3, 3, 1]) / 64
        parts = np.lib.stride_tricks.sliding_window_view(padded, (4, 4))[:12:2, :16:2]
        expected = np.pad(np.sum(weights * parts, axis=(2, 3)), ((0, 0), (pad, pad)), mode="wrap")
        assert np.abs(out - expected).max() <= (0.5 if dtype == np.uint16 else 1e-4)


def test_halve_range_keeps_to_the_nearest_surface():
    nan, inf = np.nan, np.inf
    upper, lower = [1.0, 1.0, nan, nan, 2.0, 10.0, inf, inf], [1.0, 1.0, nan, 3.0, 10.0, inf, inf, nan]
    blocks = np.array([upper, lower], np.float32)
    out = np.empty((1, 4), np.float32)
    kernels.halve_range(blocks, np.float32(1.1), out)
    assert out.tolist() == [[1.0, 3.0, 2.0, inf]]


def pool_of(pixels):
    """Return pixels (7, N) in squares, and how much each fixes by every column."""
    pool = in_blocks(pixels)
    keys = np.empty((pool.size // BLOCK * SIDE, 6), np.uint8)
    for block, some in zip(pool.reshape(-1, BLOCK), keys.reshape(-1, SIDE, 6), strict=True):
        kernels._write_keys(block, some)
    return pool, keys


def columns_of(pixels):
    """Return |J| (N, 6) of pixels (7, N)."""
    return np.abs(np.column_stack([pixels[4:].T, np.cross(pixels[:3].T, pixels[4:].T)]))


def test_each_column_gets_its_best_of_what_is_seen_and_of_pixels_that_are_alike_some_of_everywhere(rng):
    pixels = rng.normal(size=(7, 20 * SIDE)).astype(np.float32)
    pixels[4:, : 10 * SIDE] *= 100.0  # what is not seen fixes most, and counts for nothing
    _, keys = pool_of(pixels)
    seen = np.arange(10 * SIDE, 20 * SIDE, 2, dtype=np.int32)
    J = columns_of(pixels)[seen]
    for number in (6, 100, 777):
        best = kernels.best_of(seen, keys, number)
        assert best.size == number
        assert np.all(np.diff(best) > 0)
        chosen = np.isin(seen, best)
        for j in range(6):
            at_least = np.sort(J[:, j])[::-1][max(number // 6 - 1, 0)]
            assert chosen[J[:, j] > 1.3 * at_least].all()  # two steps of the keys
    pixels = np.ones((7, 8 * SIDE), np.float32)
    _, keys = pool_of(pixels)
    best = kernels.best_of(np.arange(8 * SIDE, dtype=np.int32), keys, 100)
    assert np.all(np.abs(np.diff(best) - 8 * SIDE / 100) <= 1)


def test_blocks_are_filled_up_with_what_nobody_sees(rng):
    pixels = rng.normal(size=(7, 600)).astype(np.float32)
    chosen = np.arange(0, 600, 2, dtype=np.int32)
    blocks = np.full(2 * BLOCK, 7.0, np.float32)
    inverse = kernels.gather(in_blocks(pixels), chosen, blocks)
    data = blocks.reshape(2, 7, SIDE).transpose(1, 0, 2).reshape(7, -1)
    assert np.array_equal(data[:, :300], pixels[:, chosen])
    assert np.isnan(data[2, 300:]).all()
    assert not data[[0, 1, 3, 4, 5, 6], 300:].any()
    assert inverse == pytest.approx(np.mean(1.0 / np.linalg.norm(pixels[:3, chosen], axis=0)), rel=1e-5)
    assert kernels.gather(in_blocks(pixels), chosen[:0], blocks[:0]) == 1.0


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: f"{camera.model} {camera.width}")
def test_squares_hold_points_and_hide_nothing_that_a_camera_sees(camera, rng):
    sphere = Spherical(128, 64)
    range_m = rng.uniform(1.0, 9.0, (64, 128)).astype(np.float32)
    range_m[rng.random(range_m.shape) < 0.3] = np.nan
    range_m[40:48, 16:32] = np.nan  # half a square
    image = in_steps(rng.uniform(0, 255, range_m.shape).astype(np.float32), 1)
    level = ReferenceLevel(image, sphere, 1, in_codes(range_m), 100.0)
    assert level.num_pixels == np.sum(~np.isnan(range_m[1:-1]))
    places, pool, _ = level.all()
    points = pool.reshape(-1, 7, SIDE)[places, :3].transpose(1, 0, 2)
    bounds = level.bounds[curve(128, 64)]
    for bound, some in zip(bounds[bounds[:, 3] >= 0], points.transpose(1, 2, 0), strict=True):
        off = np.linalg.norm(some[~np.isnan(some[:, 2])] - bound[:3], axis=1)
        assert off.max() <= bound[3] * 1.001
    for T in (SE3.identity(), SE3.exp(rng.normal(size=6))):
        near = level.near(T, camera)
        seen = np.empty(near.places.size * SIDE, np.int32)
        args = (kernel_motion(T.matrix), kernel_camera(camera), camera.width, camera.height)
        found = set(seen[: kernels.find_visible(near.places, near.pool, *args, seen)].tolist())
        flat = pool.reshape(-1, 7, SIDE)[:, :3].transpose(0, 2, 1).reshape(-1, 3)
        pixels, _ = camera.project(T.apply(flat))
        with np.errstate(invalid="ignore"):
            inside = np.all((pixels >= 1e-2) & (pixels <= (camera.width - 1.01, camera.height - 1.01)), axis=-1)
        inside &= np.repeat(np.isin(np.arange(len(flat) // SIDE), places), SIDE)
        assert set(np.flatnonzero(inside).tolist()) <= found
        assert len(found) < 1.05 * inside.sum() + 50


def test_ranges_are_kept_within_two_ten_thousandths_and_in_their_order(rng):
    range_m = np.exp(rng.uniform(np.log(0.01), np.log(1e4), (40, 64))).astype(np.float32)
    range_m[3, 5:9] = np.nan, np.inf, 1e-6, 1e9
    codes = in_codes(range_m)
    found = kernels.RANGES[codes]
    np.testing.assert_array_equal(found[3, [5, 6, 8]], [np.nan, np.inf, np.inf])
    assert found[3, 7] == kernels.RANGES[0] == np.float32(2.0**-8)
    is_usual = np.isfinite(found) & (range_m > 2.0**-8)
    np.testing.assert_allclose(found[is_usual], range_m[is_usual], rtol=1.69e-4)
    order = np.argsort(range_m[is_usual])
    assert np.all(np.diff(codes[is_usual][order].astype(np.int64)) >= 0)
    np.testing.assert_array_equal(in_codes(found), codes)  # nothing is lost by doing it again


def test_rays_are_those_of_the_camera():
    for camera in CAMERAS:
        tables, expected = kernel_rays(camera), pixel_rays(camera)
        found = [kernels.ray_of(tables, v, u, camera.width) for v, u in np.ndindex(expected.shape[:2])]
        np.testing.assert_allclose(found, expected.reshape(-1, 3), atol=1e-6)


def test_cover_marks_the_cells_that_pixels_fall_into(rng):
    camera, side = Pinhole(61, 47, 50.0, 52.0, 31.0, 24.5), 3
    pixels = rng.normal(size=(7, 300)).astype(np.float32) * 3
    T, covered = SE3.exp(rng.normal(size=6) * 0.2), np.zeros((16, 21), np.bool_)
    places = np.arange(2, dtype=np.int32)
    size = camera.width, camera.height
    kernels.cover(places, in_blocks(pixels), kernel_motion(T.matrix), kernel_camera(camera), *size, side, covered)
    at, is_inside = camera.project(T.apply(pixels[:3].T))
    expected = np.zeros_like(covered)
    u, v = np.floor(at[is_inside] + 0.5).astype(int).T
    expected[v // side, u // side] = True
    assert np.array_equal(covered, expected)
    assert covered.any()


SPHERE = Spherical(256, 128)
WINDOW = Spherical(100, 40, 256, 30.0, 5.0)  # of the same sphere, near its upper pole


def test_a_row_has_as_many_points_as_its_circle_has_room_for():
    is_kept = is_spaced(WINDOW)
    cosine = np.cos(np.arcsin(WINDOW.unproject(pixel_grid(WINDOW)[:, 0])[..., 2]))
    assert is_kept.shape == (WINDOW.height, WINDOW.width)
    assert np.all(np.abs(is_kept.sum(axis=1) - WINDOW.width * cosine) <= 1)


def test_ranges_stay_where_a_point_is_and_other_cameras_keep_all():
    ranges = in_codes(np.full((SPHERE.height, SPHERE.width), 2.0, np.float32))
    spaced = ranges.copy()
    keep_evenly_spaced(spaced, SPHERE)
    np.testing.assert_array_equal(spaced != UNKNOWN, is_spaced(SPHERE))
    np.testing.assert_array_equal(spaced[is_spaced(SPHERE)], ranges[is_spaced(SPHERE)])
    lens = Pinhole(20, 10, 10.0, 10.0, 9.5, 4.5)
    keep_evenly_spaced(some := ranges[:10, :20].copy(), lens)
    np.testing.assert_array_equal(some, ranges[:10, :20])


def test_each_row_begins_a_golden_part_of_a_pixel_after_the_one_above():
    """A row keeps a pixel where the way along its circle, from where it begins, passes a whole pixel."""
    is_kept, camera = is_spaced(SPHERE), SPHERE
    for row in (0, 7, camera.height // 3, camera.height // 2):
        begin = row * (np.sqrt(5.0) - 1.0) / 2.0 % 1.0
        step = np.cos(np.pi * ((row + 0.5) / camera.height - 0.5))
        passed = [int(begin + step * k) for k in range(camera.width + 1)]
        assert is_kept[row].tolist() == [after > before for before, after in pairwise(passed)]
