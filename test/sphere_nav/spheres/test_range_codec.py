import numpy as np
import pytest

from sphere_nav.spheres import range_codec


def test_decoded_range_is_within_the_promised_error_or_nan_or_far():
    range_m = np.geomspace(range_codec.MIN_RANGE, range_codec.MAX_RANGE, 200_001)
    decoded = range_codec.decode_ranges(range_codec.encode_ranges(range_m)).astype(np.float64)
    # half a step of 0.0211 %, and the rounding of float32, in which a step is known to 0.4 % of it
    assert np.abs(decoded / range_m - 1).max() < 1.08e-4
    values = np.float32([[np.nan, -np.inf, 0.0, -1.0, 0.005, np.inf, 2e4]])
    decoded = range_codec.decode_ranges(range_codec.encode_ranges(values))
    np.testing.assert_array_equal(decoded, [[np.nan] * 5 + [np.inf] * 2])


def test_a_deviation_is_kept_to_two_per_cent_whatever_the_range_or_nan_or_the_end_of_the_scale():
    rng = np.random.default_rng(4)
    range_m = rng.uniform(0.3, 100.0, (50, 100)).astype(np.float32)
    std_m = range_m * np.geomspace(1e-4, 0.313, 5000).reshape(50, 100).astype(np.float32)
    decoded = range_codec.decode_deviation(range_codec.encode_deviation(std_m, range_m), range_m)
    assert np.abs(decoded / std_m - 1).max() < 0.0185  # half a step of 3.7 %
    std_m = np.float32([[np.nan, 0.1, 0.1, 0.0, -1.0, 5.0, 1e-9]])
    range_m = np.float32([[2.0, np.nan, np.inf, 2.0, 2.0, 2.0, 2.0]])
    found = range_codec.decode_deviation(range_codec.encode_deviation(std_m, range_m), range_m)
    np.testing.assert_allclose(found, [[np.nan] * 5 + [2.0 * range_codec.MAX_RATIO, 2e-4]], rtol=1e-6)


def test_the_codes_are_those_of_the_map_format():
    """The numbers are those that a stored map was written with (msg_defs/msg/AugmentedSphere.msg)."""
    ranges = range_codec.decode_ranges(np.array([0, 1, 2, 65534, 65535], np.uint16)).astype(np.float64)
    assert np.isnan(ranges[0])
    assert ranges[1] == pytest.approx(0.01, rel=1e-6)
    assert ranges[2] == pytest.approx(0.01 * 10.0 ** (6 / 65533), rel=1e-6)  # 1 cm ... 10 km in equal ratios
    assert ranges[3] == pytest.approx(10_000.0, rel=1e-5)
    assert np.isposinf(ranges[4])
    codes = np.array([0, 1, 2, 223, 224, 225, 255], np.uint8)
    ratios = range_codec.decode_deviation(codes, np.full(7, 2.0, np.float32)).astype(np.float64) / 2.0
    step = 1e4 ** (1 / 254)
    last = 1e-4 * step**222
    expected = [1e-4, 1e-4 * step, last, last, last, last]
    assert np.isnan(ratios[0])
    np.testing.assert_allclose(ratios[1:], expected, rtol=1e-5)
    assert last == pytest.approx(0.31, abs=0.005)
