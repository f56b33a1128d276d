"""Robust statistics and weights (M15 eq. 33-35): the definition that the kernels are tested against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import SIGMA_OF_MAD

HUBER, CAUCHY = 1.345, 2.385  # standard deviations; both 95 % efficient for normal errors (M15 eq. 34; Holland 1977)


def median_and_mad(residual: NDArray[np.floating]) -> tuple[float, float]:
    """Return median and median absolute deviation of the residuals that are not NaN (eq. 12)."""
    seen = residual[~np.isnan(residual)]
    median = float(np.median(seen))
    return median, float(np.median(np.abs(seen - median)))


def huber_weights(size: NDArray[np.floating], bound: float) -> NDArray[np.floating]:
    """Return psi(d) / d for sizes d >= 0 of residuals, Huber's psi with its bound in the same unit (eq. 34)."""
    with np.errstate(divide="ignore"):  # a size of 0 weighs 1, too
        return np.minimum(1.0, bound / size)


def cauchy_weights(square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return psi(d) / d = 1 / (1 + d^2 / c^2) for the squares d^2 / c^2 of residuals by Cauchy's scale c."""
    return 1.0 / (1.0 + square)


def weigh(residual: NDArray[np.floating], min_sigma: float) -> tuple[NDArray[np.floating], float]:
    """Return Huber's weights over the variance, and its root sigma; his bound is `HUBER` sigma (eq. 33-35)."""
    median, mad = median_and_mad(residual)
    sigma = max(SIGMA_OF_MAD * mad, min_sigma)
    return huber_weights(np.abs(residual - median), HUBER * sigma) / sigma**2, sigma
