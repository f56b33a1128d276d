import numpy as np
import pytest

from sphere_map import range_codec


def test_decoded_range_is_within_the_promised_error():
    range_m = np.geomspace(range_codec.MIN_RANGE, range_codec.MAX_RANGE, 200_001)
    decoded = range_codec.decode(range_codec.encode(range_m)).astype(np.float64)
    # half a step of 0.0211 %, and the rounding of float32
    assert np.abs(decoded / range_m - 1).max() < 1.06e-4


def test_every_code_survives_decoding_and_encoding():
    codes = np.arange(65536, dtype=np.uint16)
    np.testing.assert_array_equal(range_codec.encode(range_codec.decode(codes)), codes)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.nan, np.nan),
        (-np.inf, np.nan),
        (0.0, np.nan),
        (-1.0, np.nan),
        (0.005, np.nan),
        (np.inf, np.inf),
        (2e4, np.inf),
    ],
)
def test_what_cannot_be_measured_is_nan_and_what_is_beyond_is_far(value, expected):
    decoded = range_codec.decode(range_codec.encode(np.float32([[value]])))
    np.testing.assert_array_equal(decoded, np.float32([[expected]]))


def test_farther_never_encodes_to_a_smaller_code():
    range_m = np.sort(np.random.default_rng(3).uniform(0.01, 100.0, 10_000)).astype(np.float32)
    assert np.all(np.diff(range_codec.encode(range_m).astype(int)) >= 0)


def test_other_types_are_refused():
    with pytest.raises(ValueError, match="expected uint16, found int64"):
        range_codec.decode(np.zeros(3, dtype=np.int64))
