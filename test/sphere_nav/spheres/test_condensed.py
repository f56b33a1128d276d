"""A sphere in less than half of its bytes."""

import numpy as np

from sphere_nav.geometry import Spherical
from sphere_nav.spheres import range_codec
from sphere_nav.spheres.condensed import condensed_sphere
from sphere_nav.spheres.constants import CONDENSED_DEVIATION, CONDENSED_RANGE
from sphere_nav.spheres.sphere import Sphere, to_gray_bytes


def sphere():
    """Return a sphere in colour with measured, far and unknown ranges."""
    rng = np.random.default_rng(5)
    camera = Spherical(64, 32, 64.0)
    image = rng.integers(1, 256, (camera.height, camera.width, 3), np.uint8)
    range_m = rng.uniform(0.02, 200.0, image.shape[:2]).astype(np.float32)
    range_m[0], range_m[1, :9], range_m[2, 3] = np.nan, np.inf, 0.01
    std_m = (range_m * rng.uniform(0.002, 0.1, range_m.shape)).astype(np.float32)
    std_m[~np.isfinite(range_m)] = np.nan
    return Sphere(image, range_m, camera, 7, std_m)


def test_what_is_aligned_stays_within_a_rounding():
    before = sphere()
    after = condensed_sphere(before)
    np.testing.assert_array_equal(after.image, to_gray_bytes(before.image))
    assert (after.camera, after.stamp_ns) == (before.camera, 7)
    for kind in (np.isnan, np.isinf):
        np.testing.assert_array_equal(kind(after.range_m), kind(before.range_m))
    known = before.measured & (before.range_m > 0.02)
    assert np.abs(after.range_m[known] / before.range_m[known] - 1.0).max() < 0.0027
    ratio = after.range_std_m[known] / before.range_std_m[known]
    assert 0.7 < ratio.min() < 0.8
    assert 1.25 < ratio.max() < 1.45


def test_a_condensed_sphere_stays_as_it_is():
    after = condensed_sphere(sphere())
    again = condensed_sphere(after)
    np.testing.assert_array_equal(again.image, after.image)
    np.testing.assert_array_equal(again.range_m, after.range_m)
    np.testing.assert_allclose(again.range_std_m, after.range_std_m, rtol=1e-6)
    assert condensed_sphere(Sphere(after.image, after.range_m, after.camera)).range_std_m is None


def test_codes_become_few():
    ranges = np.unique(range_codec.encode_ranges(condensed_sphere(sphere()).range_m))
    assert set(ranges[1:-1] % CONDENSED_RANGE) == {0}
    assert list(ranges[[0, -1]]) == [range_codec.CODE_NAN, range_codec.CODE_INF]
    codes = np.arange(range_codec.LAST_RATIO + 1, dtype=np.uint8)
    coarse = range_codec.coarse_deviation(codes, CONDENSED_DEVIATION)
    assert coarse[0] == range_codec.CODE_NAN
    assert len(np.unique(coarse[1:])) == 224 // CONDENSED_DEVIATION
    assert np.abs(coarse[1:].astype(int) - codes[1:]).max() <= CONDENSED_DEVIATION // 2
