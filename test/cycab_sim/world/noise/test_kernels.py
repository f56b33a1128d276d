import numpy as np
import pytest

from cycab_sim.world.noise import kernels


@pytest.fixture
def points(rng):
    return rng.uniform(-30.0, 30.0, (200, 3))


def test_octaves_at_many_points_are_the_sum_of_noise(rng):
    """The twin of `sum_octaves` by its definition: turned cells, three samples along the ellipse, faded octaves."""
    num = 300
    angle = rng.uniform(0, 2 * np.pi, num)
    points = np.empty((8, num), np.float32)
    points[:2], points[2:4] = rng.uniform(-60, 60, (2, num)), rng.uniform(0.005, 0.3, (2, num))
    points[4], points[5] = np.cos(angle), np.sin(angle)
    points[6], points[7] = rng.uniform(0.1, 1.0, num), rng.uniform(0.7, 1.0, num)
    points[3] += points[2]
    seeds = rng.integers(1, 1 << 20, num).astype(np.uint32)
    found = np.empty(num, np.float32)
    kernels.sum_octaves(points, seeds, found)
    columns = zip(points.T, seeds, strict=True)
    expected = [reference_octaves(*map(float, column), int(seed)) for column, seed in columns]
    # 32-bit coordinates: 60 m in cells of 4 mm leave 1e-3 of a cell; slopes are up to three a cell
    np.testing.assert_allclose(found, expected, atol=0.01)
    assert np.std(found) > 0.5


def reference_octaves(u, v, minor, major, bu, bv, inverse, gain, seed):
    total = 0.0
    for octave in range(kernels.MAX_OCTAVES):
        angle, cell = octave * np.arctan2(kernels.SIN, kernels.COS), 2.0**octave * inverse
        keep = max(0.0, 1.0 - (max(minor, major / 3) * cell / kernels.WINDOW) ** 2) ** 2
        for tap in (-1, 0, 1):
            a, b = u + tap * major / 3 * bu, v + tap * major / 3 * bv
            x, y = np.cos(angle) * a - np.sin(angle) * b, np.sin(angle) * a + np.cos(angle) * b
            total += gain**octave * keep / 3 * kernels.noise2(x * cell, y * cell, seed + octave)
    return total
