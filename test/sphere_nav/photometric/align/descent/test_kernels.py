"""The small algebra of a descent against NumPy and sphere_geometry."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.iteration.kernels import NUM_SUMS


@pytest.fixture
def T(rng):
    return SE3.exp(rng.normal(size=6) * 0.4)


@pytest.fixture
def system(rng):
    A = rng.normal(size=(8, 20)) * 10.0 ** rng.integers(-3, 4, (8, 1))
    return A @ A.T, rng.normal(size=8)


def rows_of(T):
    return np.ascontiguousarray(T.matrix[:3])


@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3, 0.5, 3.0])
def test_exponential_is_that_of_se3(size, rng):
    xi = rng.normal(size=6)
    xi *= size / np.linalg.norm(xi)
    assert np.abs(kernels.exponential(xi) - SE3.exp(xi).matrix[:3]).max() < 1e-12


def test_motions_are_inverted_and_composed(T, rng):
    other = SE3.exp(rng.normal(size=6))
    assert np.abs(kernels.invert(rows_of(T)) - T.inverse().matrix[:3]).max() < 1e-12
    assert np.abs(kernels.compose(rows_of(T), rows_of(other)) - (T @ other).matrix[:3]).max() < 1e-12


def test_normal_equations_are_turned_into_the_camera_tangent_by_the_adjoint(T, system):
    H, g = system
    A = np.eye(8)
    A[:6, :6] = -T.inverse().adjoint()  # M15 eq. 31-32
    turned, turned_g = H.copy(), g.copy()
    kernels.to_camera_tangent(rows_of(T), turned, turned_g)
    assert np.abs(turned - A.T @ H @ A).max() < 1e-12 * np.abs(H).max()
    assert np.abs(turned_g - A.T @ g).max() < 1e-12


def test_sums_are_the_upper_triangle_by_rows(system):
    H, g = system
    whole = np.block([[H, g[:, None]], [g[None], np.ones((1, 1))]])
    sums = np.zeros(NUM_SUMS)
    sums[:45] = whole[np.triu_indices(9)]
    found, found_g = np.empty((8, 8)), np.empty(8)
    kernels.unpack(sums, found, found_g)
    assert np.array_equal(found, H)
    assert np.array_equal(found_g, g)


def test_views_share_the_pose_and_have_a_light_each(system):
    h, q = system
    H, g = np.zeros((10, 10)), np.zeros(10)
    for view, sigma in ((0, 1.0), (1, 2.0)):
        kernels.join(view, h, q, sigma, True, H, g)
    assert np.allclose(H[:6, :6], 1.25 * h[:6, :6])
    assert np.allclose(H[:6, 8:], 0.25 * h[:6, 6:])
    assert np.allclose(H[6:8, 8:], 0.0)
    assert np.allclose(g, [*1.25 * q[:6], *q[6:], *0.25 * q[6:]])


def test_scatter_is_the_sum_of_g_by_the_inverse_of_h(rng):
    pieces, H, terms = [], np.zeros((8, 8)), []
    for _ in range(5):
        A = rng.normal(size=(9, 30))
        sums = np.zeros(NUM_SUMS)
        sums[:45] = (A @ A.T)[np.triu_indices(9)]
        pieces.append(sums)
        H += A[:8] @ A[:8].T
        terms.append(A[:8] @ A[8])
    expected = sum(g @ np.linalg.solve(H, g) for g in terms) / 4.0
    assert kernels.scatter(np.array(pieces), 2.0) == pytest.approx(expected, rel=1e-6)
    assert kernels.scatter(np.zeros((3, NUM_SUMS)), 1.0) == 0.0


@pytest.mark.parametrize(("blocks", "step", "pieces"), [(0, 1, 1), (7, 1, 1), (16, 2, 2), (40, 4, 5), (400, 4, 16)])
def test_small_views_are_not_sampled(blocks, step, pieces):
    assert kernels.scale_step(blocks) == step
    assert kernels.num_pieces(blocks) == pieces
