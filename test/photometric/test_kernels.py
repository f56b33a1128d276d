"""Each kernel beside the iteration against a few lines of NumPy."""

import numpy as np
import pytest

from photometric import kernels
from photometric.iteration.kernels import BLOCK, SIDE
from photometric.projection import kernel_camera, kernel_motion, view_cone
from sphere_geometry import SE3, Fisheye, Pinhole, Spherical

CAMERAS = [
    Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5),
    Fisheye(64, 64, 20.0, 20.5, 31.0, 32.0, (0.05, -0.06, 0.03, -0.005)),
    Spherical(128, 64),
    Spherical(40, 30, 128.0, 110.0, 12.0),
]


@pytest.mark.parametrize(("halve", "dtype"), [(kernels.halve, np.float32), (kernels.halve_bytes, np.uint8)])
@pytest.mark.parametrize("width", [16, 17])
def test_halve_weighs_1_3_3_1(halve, dtype, width, rng):
    image = rng.uniform(0, 256, (12, width)).astype(dtype)
    out = np.empty((6, 8), np.float32)
    halve(image, out)
    padded = np.pad(image, 1, mode="edge").astype(np.float64)
    weights = np.outer([1, 3, 3, 1], [1, 3, 3, 1]) / 64
    expected = [[np.sum(weights * padded[2 * v : 2 * v + 4, 2 * u : 2 * u + 4]) for u in range(8)] for v in range(6)]
    assert np.abs(out - expected).max() < 1e-4


def test_halve_range_keeps_to_the_nearest_surface():
    nan, inf = np.nan, np.inf
    upper, lower = [1.0, 1.0, nan, nan, 2.0, 10.0, inf, inf], [1.0, 1.0, nan, 3.0, 10.0, inf, inf, nan]
    blocks = np.array([upper, lower], np.float32)
    out = np.empty((1, 4), np.float32)
    kernels.halve_range(blocks, np.float32(1.1), out)
    assert out.tolist() == [[1.0, 3.0, 2.0, inf]]


def test_salient_pixels_are_picked_by_algorithm_1(rng):
    number = 400
    points = rng.uniform(-5, 5, (3, number)).astype(np.float32)
    gradient = (rng.normal(size=(3, number)) * 2.0 ** rng.integers(-12, 12, number)).astype(np.float32)
    order = np.empty((6, number), np.uint32)
    kernels.sort_columns(points, gradient, np.empty((6, number), np.uint16), order)
    J = np.abs(np.column_stack([gradient.T, np.cross(points.T, gradient.T)]))
    for j in range(6):
        column = J[order[j], j]
        ordered = column[1:] <= np.maximum(column[:-1] * 1.01, 2.0**-12)  # what is smaller is all the same
        assert np.all(ordered)
    rank = np.empty(number, np.int32)
    kernels.pick_in_turn(order, rank)
    taken, expected = set(), []
    while len(expected) < number:  # the paper's algorithm, literally, on the sorted columns
        for j in range(6):
            rest = [int(i) for i in order[j] if int(i) not in taken]
            if rest:
                taken.add(rest[0])
                expected.append(rest[0])
    assert np.argsort(rank).tolist() == expected


def test_best_of_gives_the_best_seen_pixels_in_their_order(rng):
    rank = rng.permutation(5000).astype(np.int32)
    seen = np.flatnonzero(rng.random(5000) < 0.5).astype(np.int32)
    for number in (1, 100, 1777):
        expected = np.sort(seen[np.argsort(rank[seen])[:number]])
        assert np.array_equal(kernels.best_of(seen, rank, number), expected)


def test_blocks_are_filled_up_with_what_nobody_sees(rng):
    points, gradient = rng.normal(size=(2, 3, 600)).astype(np.float32)
    intensity = rng.uniform(0, 255, 600).astype(np.float32)
    chosen = np.arange(0, 600, 2, dtype=np.int32)
    blocks = np.full(2 * BLOCK, 7.0, np.float32)
    inverse = kernels.fill_blocks(points, intensity, gradient, chosen, blocks)
    data = blocks.reshape(2, 7, SIDE).transpose(1, 0, 2).reshape(7, -1)
    assert np.array_equal(data[:, :300], np.vstack([points, intensity, gradient])[:, chosen])
    assert np.isnan(data[2, 300:]).all()
    assert not data[[0, 1, 3, 4, 5, 6], 300:].any()
    assert inverse == pytest.approx(np.mean(1.0 / np.linalg.norm(points[:, chosen], axis=0)), rel=1e-5)
    assert kernels.fill_blocks(points, intensity, gradient, chosen[:0], blocks[:0]) == 1.0


def test_bounds_hold_their_points(rng):
    points = rng.normal(size=(3, 700)).astype(np.float32)
    bounds = np.empty((3, 4), np.float32)
    kernels.bound_blocks(points, bounds)
    for b, (*centre, radius) in enumerate(bounds):
        off = np.linalg.norm(points[:, b * SIDE : (b + 1) * SIDE].T - centre, axis=1)
        assert radius * 0.999 < off.max() <= radius * 1.001


def test_the_cone_of_a_camera_hides_nothing_that_it_sees(rng):
    points = (rng.normal(size=(3, 20000)) * [[8.0], [8.0], [8.0]]).astype(np.float32)
    points = np.ascontiguousarray(points[:, np.argsort(np.arctan2(points[1], points[0]))])
    bounds = np.empty((-(-20000 // SIDE), 4), np.float32)
    kernels.bound_blocks(points, bounds)
    for camera in CAMERAS:
        for T in (SE3.identity(), SE3.exp(rng.normal(size=6))):
            seen = np.empty(20000, np.int32)
            args = (kernel_motion(T.matrix), kernel_camera(camera), view_cone(camera), camera.width, camera.height)
            found = set(seen[: kernels.find_visible(points, bounds, *args, seen)].tolist())
            pixels, _ = camera.project(T.apply(points.T))
            with np.errstate(invalid="ignore"):
                inside = np.all((pixels >= 1e-2) & (pixels <= (camera.width - 1.01, camera.height - 1.01)), axis=-1)
            assert set(np.flatnonzero(inside).tolist()) <= found
            assert len(found) < 1.05 * inside.sum() + 50
