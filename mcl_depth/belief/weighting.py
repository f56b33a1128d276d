"""From similarities to weights: w = s ** lambda with s scale_similarities to at most 1 (N17 section III-C)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.params import WeightParams

Array = NDArray[np.float64]
CHANCE = 4.0 / np.pi  # similarity of images that have nothing to do with each other: E|c| = 2 / pi, twice (eq. 2)
SEARCH_STEPS = 24  # halvings of the interval of lambda: 1e-7 of it


def scale_similarities(similarities: Array, scaling: str) -> Array:
    """Scale similarities (N,) so that the largest is 1; 0 is nothing, what chance gives, or the smallest of them.

    `maximum`: s / max(s). `chance`: what exceeds the similarity of unrelated images. `minmax`: N17.
    """
    low = {"maximum": 0.0, "chance": CHANCE, "minmax": float(similarities.min())}[scaling]
    high = float(similarities.max())
    if not high > low:
        return np.ones(len(similarities))
    return np.clip((similarities - low) / (high - low), 0.0, 1.0)


def compute_weights(similarities: Array, params: WeightParams, prior: Array) -> Array:
    """Return weights (N,) of sum 1: `prior` times s ** lambda; all alike where nothing distinguishes them.

    `min_effective_share` > 0 lowers lambda for this image until so large a share of the particles carries the belief:
    one picture alone may not decide between places that look alike. Places off the map (s = 0) are not among them.
    """
    is_possible = similarities > 0.0
    if is_possible.any():
        prior = np.where(is_possible, prior, 0.0)
    logs = np.log(np.maximum(scale_similarities(similarities, params.scaling), 1e-30))
    exponent = params.exponent
    wanted = params.min_effective_share * int(np.count_nonzero(is_possible))
    if wanted > 0.0 and _effective(exponent * logs, prior) < wanted:
        low, high = 0.0, exponent
        for _ in range(SEARCH_STEPS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _effective(middle * logs, prior) > wanted else (low, middle)
        exponent = low
    return _normalised(exponent * logs, prior)


def _normalised(logs: Array, prior: Array) -> Array:
    result = prior * np.exp(logs - logs.max())
    total = float(result.sum())
    return result / total if total > 0.0 else np.full(len(result), 1.0 / len(result))


def _effective(logs: Array, prior: Array) -> float:
    return float(1.0 / np.sum(_normalised(logs, prior) ** 2))
