"""One pass over the pixels against a few lines of NumPy, and against the definitions in sphere_geometry."""

import numpy as np
import pytest

from sphere_nav.estimation.least_squares import median_and_mad
from sphere_nav.geometry import Fisheye, Omni, Pinhole, Spherical
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling
from sphere_nav.photometric.align.iteration import kernels
from sphere_nav.photometric.pixels.pyramid import kernel_camera, rolling
from worlds.blocks import Case, points_before, rows

CAMERAS = [
    Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5, (-0.2, 0.05, 1e-3, -2e-3, 0.01)),
    Fisheye(64, 64, 20.0, 20.5, 31.0, 32.0, (0.05, -0.06, 0.03, -0.005)),
    DoubleSphere(64, 64, 30.0, 30.5, 31.0, 32.0, 0.3, 0.4),
    Omni(64, 48, 90.0, 91.0, 31.0, 24.5, 1.9, (-0.2, 0.3, 1e-3, -5e-4)),
    Spherical(40, 30, 128.0, 110.0, 12.0),
]
NAMES = ["distorted", "fisheye", "double sphere, alpha < 1/2", "omni, xi > 1", "window"]


def project(camera, points):
    """Return pixels (N, 2), J (N, 2, 3) and visibility (N,) of up to SIDE points (N, 3)."""
    r = np.zeros(kernels.SCRATCH, np.float32)
    scratch = r.reshape(-1, kernels.SIDE)
    scratch[:3] = np.nan
    scratch[:3, : len(points)] = np.asarray(points).T
    kernels.project(*kernel_camera(camera)[:2], r)
    first = kernels.J0 // kernels.SIDE
    pixels = scratch[[kernels.U // kernels.SIDE, kernels.V // kernels.SIDE]].T
    J, seen = scratch[first : first + 6].T.reshape(-1, 2, 3), scratch[kernels.SEEN // kernels.SIDE] > 0
    assert np.isfinite(J).all()  # what is not visible must not spoil the sums
    assert not seen[len(points) :].any()
    return pixels[: len(points)], J[: len(points)], seen[: len(points)]


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_projection_and_its_jacobian_are_those_of_sphere_geometry(camera, rng):
    points = points_before(camera, rng)[: kernels.SIDE]
    pixels, J, seen = project(camera, points)
    expected, _ = camera.project(points)
    assert seen.all()
    assert np.abs(pixels - expected).max() < 2e-4  # float32 at a few hundred pixels
    J_expected = camera.J_project(points)
    assert np.abs(J - J_expected).max() / np.abs(J_expected).max() < 1e-5


def test_what_has_no_pixel_or_is_behind_the_fold_of_a_polynomial_is_not_visible():
    for camera in CAMERAS[:4]:
        points = np.array([[0.1, 0.1, -1.0], [0.0, 0.0, 0.0], [1e4, 1e4, 1e-5], [1e-3, 0.0, -5.0]])
        expected, _ = camera.project(points)
        seen = project(camera, points)[2]
        assert not seen[np.isnan(expected).any(axis=-1)].any()
    folding = Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5, (-0.3,))  # turns back at a radius of 1.05
    assert project(folding, [[1.8, 0.0, 1.0], [0.5, 0.0, 1.0]])[2].tolist() == [False, True]


def test_arctangent_is_exact_to_float32_in_all_quadrants(rng):
    y, x = rng.normal(size=(2, 4000)).astype(np.float32)
    found = np.array([kernels.arctangent2(a, b) for a, b in zip(y, x, strict=True)])
    assert np.abs(found - np.arctan2(y, x)).max() < 1e-6


@pytest.fixture
def scratch():
    return np.empty(kernels.SCRATCH, np.float32), np.empty(kernels.SIDE, np.int32)


def test_bytes_and_floats_of_one_image_give_the_same_sums(rng, scratch):
    case, found = Case(rng, CAMERAS[0], dtype=np.uint8), np.zeros((2, kernels.NUM_SUMS))
    light = np.float32([1.0, 0.0, 0.0, 30.0])  # gain, bias, median, bound
    for sums in found:
        number = case.blocks.size // kernels.BLOCK
        kernels.accumulate(case.blocks, 0, number, *case.arguments, *light, *scratch, sums, np.zeros(5))
        case.level = type(case.level)(case.image.astype(np.float32), case.camera, 0)
    assert found[0].any()
    assert np.array_equal(*found)


def test_the_scale_is_the_median_and_mad_of_the_residuals(rng, scratch):
    case = Case(rng, CAMERAS[0])
    args = (*case.arguments, np.float32(1.0), np.float32(0.0), *scratch, np.empty(kernels.NUM_BINS, np.int32))
    median, mad, number = kernels.scale(case.blocks, 1, *args)
    seen, residual, _ = case.twin()
    expected = median_and_mad(residual[seen])
    assert abs(number - seen.sum()) <= 3
    assert abs(median - expected[0]) < 1.0 / kernels.BINS_PER_GRAY
    assert abs(mad - expected[1]) < 1.0 / kernels.BINS_PER_GRAY
    assert kernels.scale(case.blocks, 2, *args)[2] < 0.6 * number  # every second block


@pytest.mark.parametrize("camera", CAMERAS[:4], ids=NAMES[:4])
def test_rows_of_a_rolling_shutter_are_moved_to_their_time(camera, rng, scratch):
    case = Case(rng, camera)
    twist = np.array([0.02, -0.01, 0.03, 0.01, -0.015, 0.01])
    block = case.blocks[: kernels.BLOCK]
    T, _, image = case.arguments
    kernels.locate(T, rolling(camera, twist), image, block, *scratch)
    rows_of = scratch[0].reshape(-1, kernels.SIDE)
    seen = rows_of[kernels.SEEN // kernels.SIDE] > 0
    found = rows_of[[kernels.U // kernels.SIDE, kernels.V // kernels.SIDE]].T[seen]
    points = case.T.apply(rows(block, kernels.BLOCK)[:3].T[seen].astype(np.float64))
    expected, _ = project_rolling(camera, points, twist)
    moved = np.linalg.norm(expected - camera.project(points)[0], axis=1)
    assert np.percentile(moved, 90) > 0.15
    assert np.percentile(np.linalg.norm(found - expected, axis=1), 90) < 0.01  # first order: half of (s twist)^2 f
