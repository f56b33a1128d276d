"""From similarities to weights: w = s ** lambda with s scaled to at most 1 (N17 section III-C)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EXPONENT = 20.0  # lambda (N17 table I)
MIN_EFFECTIVE_SHARE = 0.1  # of the particles that survive one image: lambda is lowered for it
CHANCE = 4.0 / np.pi  # similarity of images that have nothing to do with each other: E|c| = 2 / pi, twice (eq. 2)
SEARCH_STEPS = 24  # halvings of the interval of lambda: 1e-7 of it


def scale_similarities(similarities: Array) -> Array:
    """Scale similarities (N,) so that the largest is 1 and what chance gives, or less, is 0."""
    high = float(similarities.max())
    if not high > CHANCE:
        return np.ones(len(similarities))
    return np.clip((similarities - CHANCE) / (high - CHANCE), 0.0, 1.0)


def compute_weights(
    similarities: Array, prior: Array, exponent: float = EXPONENT, min_effective_share: float = MIN_EFFECTIVE_SHARE
) -> Array:
    """Return weights (N,) of sum 1: `prior` times s ** lambda; all alike where nothing distinguishes them.

    One picture alone may not decide between places that look alike: lambda is lowered until `min_effective_share` of
    the particles carries the belief. Places off the map (s = 0) are not among them.
    """
    is_possible = similarities > 0.0
    if is_possible.any():
        prior = np.where(is_possible, prior, 0.0)
    logs = np.log(np.maximum(scale_similarities(similarities), 1e-30))
    wanted = min_effective_share * int(np.count_nonzero(is_possible))
    if wanted > 0.0 and _effective(exponent * logs, prior) < wanted:
        low, high = 0.0, exponent
        for _ in range(SEARCH_STEPS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _effective(middle * logs, prior) > wanted else (low, middle)
        exponent = low
    return _normalise(exponent * logs, prior)


def _normalise(logs: Array, prior: Array) -> Array:
    result = prior * np.exp(logs - logs.max())
    total = float(result.sum())
    return result / total if total > 0.0 else np.full(len(result), 1.0 / len(result))


def _effective(logs: Array, prior: Array) -> float:
    return float(1.0 / np.sum(_normalise(logs, prior) ** 2))
