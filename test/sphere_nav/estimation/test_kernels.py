"""The compiled step against NumPy."""

import numpy as np
import pytest

from sphere_nav.estimation import kernels


@pytest.fixture
def system(rng):
    A = rng.normal(size=(8, 20)) * 10.0 ** rng.integers(-3, 4, (8, 1))
    return A @ A.T, rng.normal(size=8)


def test_newton_step_finds_the_minimum_of_the_quadratic(system):
    H, g = system
    x, is_found = kernels.newton_step(H, g, 0)
    assert is_found
    assert np.abs(H @ x + g).max() < 1e-9 * np.abs(g).max()
    rest, _ = kernels.newton_step(H, g, 3)  # a pure rotation leaves the translation out
    assert np.abs(H[3:, 3:] @ rest + g[3:]).max() < 1e-9 * np.abs(g).max()


def test_newton_step_refuses_what_is_not_positive_definite(system):
    for spoil in [0.0, -1.0, np.nan, np.inf]:
        H, g = system
        H[3, :] = H[:, 3] = 0.0
        H[3, 3] = spoil
        assert not kernels.newton_step(H, g, 0)[1]
