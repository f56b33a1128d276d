"""Range as 16 bit: a logarithmic scale, so that the relative error is the same at every distance.

Code 0 is NaN (not measured), 65535 is +Inf (known to be far), 1...65534 are 0.01 m ... 10 km in equal ratios of
0.021 %, so that a decoded range is within 0.0108 % of the encoded one. Its standard deviation as 8 bit of the ratio to
it: code 0 is NaN, 1...223 are 0.01 % ... 31 % in equal ratios of 3.7 %; more is 31 %.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Bytes, Floats

MIN_RANGE = 0.01  # metres; what is nearer is not measured
MAX_RANGE = 10_000.0  # metres; what is farther is far
CODE_NAN = 0
CODE_INF = 65535
NUM_STEPS = CODE_INF - 2
STEP = np.log(MAX_RANGE / MIN_RANGE) / NUM_STEPS
MIN_RATIO, RATIO_STEP = 1e-4, np.log(1e4) / 254  # of a deviation to its range
LAST_RATIO = 223  # code of the largest ratio
MAX_RATIO = MIN_RATIO * np.exp(RATIO_STEP * (LAST_RATIO - 1))


def encode_ranges(range_m: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    """Return the codes of ranges in metres, of any shape; anything below `MIN_RANGE` becomes 'not measured'."""
    values = np.asarray(range_m, dtype=np.float32)
    with np.errstate(invalid="ignore", divide="ignore"):
        steps = np.log(values * np.float32(1 / MIN_RANGE)) * np.float32(1 / STEP)
    steps[np.isnan(steps)] = -1.0
    codes = np.clip(np.rint(steps) + np.float32(1.0), CODE_NAN, NUM_STEPS + 1)
    codes[steps > NUM_STEPS + 0.5] = CODE_INF
    return codes.astype(np.uint16)


def decode_ranges(codes: NDArray[np.uint16]) -> Floats:
    """Return the ranges in metres of codes of any shape."""
    if codes.dtype != np.uint16:
        raise ValueError(f"range codes: expected uint16, found {codes.dtype}")
    return np.take(_table(), codes, mode="clip")  # no code is outside: nothing to check


def encode_deviation(range_std_m: NDArray[np.floating[Any]], range_m: NDArray[np.floating[Any]]) -> Bytes:
    """Return the codes of standard deviations by their ratio to the range, both in metres and of one shape.

    Ratios beyond the scale are its ends; where the range is not finite nothing is said.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.asarray(range_std_m, dtype=np.float32) / np.asarray(range_m, dtype=np.float32)
        steps = np.log(ratio * np.float32(1 / MIN_RATIO)) * np.float32(1 / RATIO_STEP)
    is_known = (ratio > 0) & np.isfinite(ratio)
    codes = np.where(is_known, np.clip(np.rint(steps) + np.float32(1.0), 1, LAST_RATIO), CODE_NAN)
    return codes.astype(np.uint8)


def decode_deviation(codes: Bytes, range_m: Floats) -> Floats:
    """Return the standard deviations in metres of codes beside their ranges, NaN where either is not known."""
    if codes.dtype != np.uint8:
        raise ValueError(f"deviation codes: expected uint8, found {codes.dtype}")
    deviation = _ratios()[codes] * range_m
    deviation[~np.isfinite(deviation)] = np.nan
    return deviation


@cache
def _ratios() -> Floats:
    codes = np.arange(256)
    table = (MIN_RATIO * np.exp(RATIO_STEP * (np.minimum(codes, LAST_RATIO) - 1.0))).astype(np.float32)
    table[CODE_NAN] = np.nan
    return table


@cache
def _table() -> Floats:
    table = (MIN_RANGE * np.exp(STEP * (np.arange(CODE_INF + 1) - 1.0))).astype(np.float32)
    table[CODE_NAN], table[CODE_INF] = np.nan, np.inf
    return table
