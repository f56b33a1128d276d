"""What lies on a road: marks as long as the way between crossings, patches and covers within the kerbs."""

import numpy as np
import pytest

from cycab_sim.world.mesh import MeshBuilder, placed
from cycab_sim.world.street import add_street
from cycab_sim.world.texture import kernels as k

LENGTH, HALF = 400.0, 3.0


def street(crossings=(), seed=1, placement=None):
    """Return the corners (S, 6, 3) of each surface of a street along x, its kinds (S,) and colors (S, 3)."""
    mesh = MeshBuilder(np.random.default_rng(0))
    at = placed(0.0, 0.0, 0.0) if placement is None else placement
    add_street(mesh, at, LENGTH, crossings, np.random.default_rng(seed), HALF)
    built = mesh.build()
    return built.triangles.reshape(-1, 6, 3), built.kinds[:, 0], built.colors


def sides(corners):
    """Return the lengths (S, 3) of surfaces along the axes."""
    return np.ptp(corners, axis=1)


def test_dashes_stop_before_a_crossing_and_stripes_lie_before_and_behind():
    corners, kinds, _ = street(crossings=(100.0,))
    marks = corners[kinds == k.MARKING]
    low, high = marks[..., 0].min(axis=1), marks[..., 0].max(axis=1)
    inner = HALF + 0.6
    expected = [(0.0, 100 - inner - 3.5), (100 + inner + 3.5, LENGTH), (100 - inner - 2.9, 100 - inner - 0.1)]
    expected += [(100 + inner + 0.1, 100 + inner + 2.9)]
    np.testing.assert_allclose(np.sort(low), np.sort([a for a, _ in expected]), atol=1e-3)
    np.testing.assert_allclose(np.sort(high), np.sort([b for _, b in expected]), atol=1e-3)
    assert np.ptp(marks[2:, :, 1], axis=1) == pytest.approx(2 * HALF)
    gutters = corners[np.isclose(sides(corners)[:, 1], 0.3, atol=1e-4)]
    np.testing.assert_allclose(np.sort(gutters[:, :, 1].min(axis=1)), [-HALF, -HALF, HALF - 0.3, HALF - 0.3], atol=1e-5)
    for a, b in expected[:2]:
        part = gutters[(gutters[..., 0] > a).all(axis=1) & (gutters[..., 0] < b).all(axis=1)]
        np.testing.assert_allclose(np.sort(part[..., 0].ravel())[[0, -1]], [a + 3, b - 3], atol=1e-3)
