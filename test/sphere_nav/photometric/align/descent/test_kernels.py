"""The small algebra of a descent against NumPy and sphere_geometry."""

import numpy as np
import pytest

from sphere_nav.estimation.least_squares import huber_weights, median_and_mad
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.iteration.kernels import NUM_SUMS
from sphere_nav.photometric.pixels.pyramid import kernel_camera
from worlds.blocks import Case


@pytest.fixture
def T(rng):
    return SE3.exp(rng.normal(size=6) * 0.4)


def rows_of(T):
    return np.ascontiguousarray(T.matrix[:3])


def test_motions_are_those_of_se3(T, rng):
    for size in [0.0, 1e-6, 1e-3, 0.5, 3.0]:
        xi = rng.normal(size=6)
        xi *= size / np.linalg.norm(xi)
        assert np.abs(kernels.exponential(xi) - SE3.exp(xi).matrix[:3]).max() < 1e-12
    other = SE3.exp(rng.normal(size=6))
    assert np.abs(kernels.invert(rows_of(T)) - T.inverse().matrix[:3]).max() < 1e-12
    assert np.abs(kernels.compose(rows_of(T), rows_of(other)) - (T @ other).matrix[:3]).max() < 1e-12


def test_small_views_are_not_sampled():
    for blocks, step, pieces in [(0, 1, 1), (7, 1, 1), (16, 2, 2), (40, 4, 5), (400, 4, 16)]:
        assert kernels.scale_step(blocks) == step
        assert kernels.num_pieces(blocks) == pieces


def test_by_body_says_how_an_increment_of_the_body_moves_the_reference(T):
    """T_body_reference of T_world_body exp(xi) is exp(-xi) T = T exp(x) with x = A xi; light stays as it is."""
    A, step = kernels.by_body(rows_of(T)), 1e-6
    numeric = [(T.inverse() @ SE3.exp(-step * xi) @ T).log() / step for xi in np.eye(6)]
    np.testing.assert_allclose(A[:6, :6], np.stack(numeric, axis=1), atol=1e-5)
    np.testing.assert_array_equal(A[6:, 6:], np.eye(2))
    assert not A[:6, 6:].any()
    assert not A[6:, :6].any()


CAMERA, HUBER, MIN_SIGMA = Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5), 1.345, 1.0


def room():
    """Return room for facts and pieces of all views."""
    facts = np.full((2, kernels.NUM_FACTS), np.nan)
    return facts, np.full((2, kernels.NUM_PIECES, NUM_SUMS), np.nan)


def whole_of(case, gain, bias):
    """Return weighted products (9, 9) of columns and residual, sigma, visible and inliers, residuals, by NumPy."""
    seen, e, J = case.twin(gain, bias)
    e, J = e[seen], J[seen]
    median, mad = median_and_mad(e)
    sigma = max(1.4826 * mad, MIN_SIGMA)
    J = np.column_stack([J, e])
    weight = huber_weights(np.abs(e - median), HUBER * sigma)
    inliers = np.sum(np.abs(e - median) <= HUBER * sigma)
    return (J * weight[:, None]).T @ J, sigma, seen.sum(), inliers, (median, mad)


def test_examine_compares_all_pixels_in_pieces(rng):
    case, (facts, pieces) = Case(rng, CAMERA, number=20_000), room()
    gain, bias = 1.2, -6.0
    T = rows_of(case.T)
    kernels.examine(case.blocks, T, *case.arguments[1:], gain, bias, HUBER, MIN_SIGMA, facts[0], pieces[0])
    expected, _, visible, inliers, (median, mad) = whole_of(case, gain, bias)
    count = int(facts[0, kernels.NUM_CUT])
    assert count == kernels.num_pieces(case.blocks.size // (7 * 256)) > 4
    assert np.isnan(pieces[0, count:]).all()
    found, scale = pieces[0, :count].sum(axis=0), np.sqrt(np.diag(expected))
    difference = (found[:45] - expected[np.triu_indices(9)]) / np.outer(scale, scale)[np.triu_indices(9)]
    assert np.abs(difference).max() < 0.01  # a quarter of the blocks: sigma
    assert facts[0, kernels.NUM_VISIBLE] == pytest.approx(visible, abs=10)
    assert facts[0, kernels.NUM_INLIERS] == pytest.approx(inliers, rel=0.02)
    assert facts[0, kernels.MEDIAN] == pytest.approx(median, abs=0.1 * mad)
    assert facts[0, kernels.MAD] == pytest.approx(mad, rel=0.05)
    seen, _, J = case.twin(gain, bias)
    r, c = case.data[3][seen].astype(np.float64), J[seen, 6]
    sums = [r.sum(), c.sum(), r @ c, r @ r, c @ c]
    np.testing.assert_allclose(facts[0, kernels.SUM_REFERENCE :], sums, rtol=2e-3)


def test_linearize_joins_the_views_by_their_variances(rng):
    cases, (facts, pieces) = [Case(rng, CAMERA), Case(rng, CAMERA, number=2000)], room()
    cases[1].level = cases[0].level  # one image, two references
    cases[1].image = cases[0].image
    T_world_camera = SE3.exp(rng.normal(size=6) * 0.3)
    T_world_reference = np.stack([rows_of(T_world_camera @ case.T) for case in cases])
    light = np.array([[1.2, -6.0], [0.9, 4.0]])
    blocks = tuple(case.blocks for case in cases) * 2  # beyond the second they do not count
    images = 4 * (kernel_camera(CAMERA),), 4 * (cases[0].level.samples,)
    T_body_camera = SE3.exp(rng.normal(size=6) * 0.3)
    T_camera_body = np.tile(rows_of(T_body_camera.inverse()), (2, 1, 1))
    T_world_body = rows_of(T_world_camera @ T_body_camera.inverse())
    views, robust = (blocks, *images, 2, T_world_reference, T_camera_body), (HUBER, MIN_SIGMA)
    H, g, visible = kernels.linearize(views, T_world_body, light, robust, facts, pieces)
    expected, expected_g, number = np.zeros((10, 10)), np.zeros(10), 0
    for k, case in enumerate(cases):
        products, sigma, count, _, _ = whole_of(case, *light[k])
        A = np.zeros((8, 10))
        A[:6, :6] = -(T_body_camera @ case.T).inverse().adjoint()
        A[6:, 6 + 2 * k : 8 + 2 * k] = np.eye(2)
        expected += A.T @ products[:8, :8] @ A / sigma**2
        expected_g += A.T @ products[:8, 8] / sigma**2
        number += count
    scale = np.sqrt(np.diag(expected))
    assert np.abs((H - expected) / np.outer(scale, scale)).max() < 0.01
    assert np.abs((g - expected_g) / scale).max() < 0.01 * np.sqrt(number)
    assert visible == pytest.approx(number, abs=6)
