import numpy as np
import pytest

from cycab_sim.world.noise import kernels

POINT = (1e-9, 1e-9, 1.0, 0.0, 1e-9, 1e-9)  # a footprint that filters nothing


def foot(width):
    return (width, width, 1.0, 0.0, width, width)


def plain(kernel):
    return getattr(kernel, "py_func", kernel)


@pytest.fixture
def points(rng):
    return rng.uniform(-30.0, 30.0, (200, 3))


def test_compiled_noise_is_its_own_python_body(points):
    for x, y, z in points[:40]:
        assert kernels.noise2(x, y, 7) == pytest.approx(plain(kernels.noise2)(x, y, 7), abs=1e-12)
        assert kernels.noise3(x, y, z, 7) == pytest.approx(plain(kernels.noise3)(x, y, z, 7), abs=1e-12)
    assert [kernels.hashed(i, -i, 3, 9) for i in range(99)] == [plain(kernels.hashed)(i, -i, 3, 9) for i in range(99)]


def test_hash_is_uniform_and_without_correlation_between_neighbours():
    h = np.array([[kernels.hashed(i, j, 0, 5) for i in range(64)] for j in range(64)])
    assert abs(h.mean()) < 4 * 0.577 / 64  # four standard errors of a uniform variable in [-1, 1)
    assert h.std() == pytest.approx(0.577, abs=0.02)
    for a, b in ((h[:, 1:], h[:, :-1]), (h[1:], h[:-1]), (h[1:, 1:], h[:-1, :-1])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 4 / 63


def test_noise_is_continuous_across_cells_and_differs_between_seeds(points):
    for x, y, z in points:
        i, step = float(np.floor(x)), 1e-7
        assert kernels.noise2(i - step, y, 3) == pytest.approx(kernels.noise2(i + step, y, 3), abs=1e-5)
        assert kernels.noise3(x, y, np.floor(z) - step, 3) == pytest.approx(
            kernels.noise3(x, y, np.floor(z) + step, 3), abs=1e-5
        )
    levels = [[kernels.noise2(x, y, seed) for x, y, _ in points] for seed in (3, 4)]
    assert abs(np.corrcoef(levels)[0, 1]) < 0.3  # 200 points: four standard errors


@pytest.mark.slow
def test_octaves_have_the_same_contrast_and_vanish_below_the_footprint(points):
    def spread(octaves, width):
        return np.std([kernels.fbm2(x, y, foot(width), 4.0, 1.0, octaves, 5) for x, y, _ in points])

    assert spread(8, 1e-9) ** 2 == pytest.approx(8 * spread(1, 1e-9) ** 2, rel=0.35)  # variances of 200 samples
    assert spread(8, 8.0) == 0.0
    assert spread(8, 0.5) == pytest.approx(spread(3, 0.5), rel=0.05)  # cells of 0.5 m and less are nearly gone
    wide = [kernels.fbm3(*p, foot(8.0), 4.0, 1.0, 8, 5) for p in points]
    assert np.all(np.array(wide) == 0.0)


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


@pytest.mark.parametrize("width", [0.001, 0.3, 1.0, 2.7])
def test_a_pulse_train_is_averaged_exactly(width, rng):
    for x in rng.uniform(-9, 9, 30):
        at = x + width * ((np.arange(4000) + 0.5) / 4000 - 0.5)
        expected = np.mean((at / 1.3) % 1.0 < 0.35)
        assert kernels.pulse(x, 1.3, 0.35, width) == pytest.approx(expected, abs=2e-3)


def test_an_interval_is_averaged_exactly():
    for x, expected in ((-1.0, 0.0), (0.0, 0.5), (0.05, 0.75), (0.5, 1.0), (1.0, 0.5), (2.0, 0.0)):
        assert kernels.within(x, 0.0, 1.0, 0.2) == pytest.approx(expected)
    assert kernels.step(0.1, 0.2) == 1.0


def test_joints_have_their_share_of_the_area(rng):
    points = rng.uniform(0, 40, (4000, 2))
    share = np.mean([kernels.joints(u, v, 0.5, 0.25, 0.02, 0.5, foot(1e-6)) for u, v in points])
    expected = 1 - (0.48 / 0.5) * (0.23 / 0.25)
    assert share == pytest.approx(expected, abs=4 * np.sqrt(expected / 4000))
    assert kernels.joints(3.1, 7.7, 0.5, 0.25, 0.02, 0.5, foot(5.0)) == pytest.approx(expected, rel=0.05)


def test_cells_are_constant_inside_and_fade_when_they_are_small():
    inside = {kernels.cells(0.05 + 0.08 * i, 0.1, 1.0, 0.5, 0.0, foot(1e-4), 9) for i in range(11)}
    assert max(inside) - min(inside) < 1e-9
    assert kernels.cells(0.5, 0.1, 1.0, 0.5, 0.0, foot(1e-4), 9) != kernels.cells(
        1.5, 0.1, 1.0, 0.5, 0.0, foot(1e-4), 9
    )
    assert abs(kernels.cells(0.5, 0.1, 1.0, 0.5, 0.0, foot(3.0), 9)) < 1e-9


def test_a_line_keeps_its_share_when_it_is_blurred():
    for width in (0.001, 0.05, 0.3):
        d = np.linspace(-2.0, 2.0, 8001)
        total = np.trapezoid([kernels.line(abs(x), 0.02, foot(width)) for x in d], d)
        assert total == pytest.approx(0.02, rel=0.01)
