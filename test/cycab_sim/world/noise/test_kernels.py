import numpy as np
import pytest

from cycab_sim.world.noise import kernels

POINT = (1e-9, 1e-9, 1.0, 0.0, 1e-9, 1e-9)  # a footprint that filters nothing


def foot(width):
    return (width, width, 1.0, 0.0, width, width)


@pytest.fixture
def points(rng):
    return rng.uniform(-30.0, 30.0, (200, 3))


def test_filtered_octaves_are_the_unfiltered_ones_through_a_lens(rng):
    """The mean under a Gaussian of half a pixel, which is what a good lens does."""
    width, offsets = 0.30, np.linspace(-1.5, 1.5, 21)
    weights = np.exp(-0.5 * (offsets / 0.5) ** 2)
    weights = np.outer(weights, weights) / weights.sum() ** 2
    true, filtered = [], []
    for x, y in rng.uniform(-20, 20, (150, 2)):
        patch = [[kernels.fbm2(x + a * width, y + b * width, POINT, 4.0, 1.0, 9, 5) for a in offsets] for b in offsets]
        true.append(np.sum(weights * patch))
        filtered.append(kernels.fbm2(x, y, foot(width), 4.0, 1.0, 9, 5))
    assert np.corrcoef(true, filtered)[0, 1] > 0.92  # an octave is damped as a whole, a lens damps its parts
    assert np.std(np.subtract(true, filtered)) < 0.4 * np.std(true)


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


@pytest.mark.parametrize("width", [0.3])
def test_a_pulse_train_is_averaged_exactly(width, rng):
    for x in rng.uniform(-9, 9, 30):
        at = x + width * ((np.arange(4000) + 0.5) / 4000 - 0.5)
        expected = np.mean((at / 1.3) % 1.0 < 0.35)
        assert kernels.pulse(x, 1.3, 0.35, width) == pytest.approx(expected, abs=2e-3)
