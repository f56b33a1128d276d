"""Range as 16 bit: a logarithmic scale, so that the relative error is the same at every distance.

Code 0 is NaN (not measured), 65535 is +Inf (known to be far), 1...65534 are 0.01 m ... 10 km in equal ratios of
0.021 %, so that a decoded range is within 0.0106 % of the encoded one.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

MIN_RANGE = 0.01  # metres; what is nearer is not measured
MAX_RANGE = 10_000.0  # metres; what is farther is far
CODE_NAN = 0
CODE_INF = 65535
NUM_STEPS = CODE_INF - 2
STEP = np.log(MAX_RANGE / MIN_RANGE) / NUM_STEPS


def encode(range_m: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    """Return the codes of ranges in metres, of any shape; anything below `MIN_RANGE` becomes 'not measured'."""
    values = np.asarray(range_m, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        steps = np.log(values / MIN_RANGE) / STEP
        codes = np.rint(np.nan_to_num(steps, nan=-1.0)) + 1
        codes = np.where(steps > NUM_STEPS + 0.5, CODE_INF, np.clip(codes, CODE_NAN, CODE_INF))
    return codes.astype(np.uint16)


def decode(codes: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return the ranges in metres of codes of any shape."""
    if codes.dtype != np.uint16:
        raise ValueError(f"range codes: expected uint16, found {codes.dtype}")
    return _table()[codes]


@cache
def _table() -> NDArray[np.float32]:
    table = (MIN_RANGE * np.exp(STEP * (np.arange(CODE_INF + 1) - 1.0))).astype(np.float32)
    table[CODE_NAN], table[CODE_INF] = np.nan, np.inf
    return table
