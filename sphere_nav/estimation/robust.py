"""Robust statistics and weights (M15 eq. 33-35): the definition that the kernels are tested against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import SIGMA_OF_MAD


def median_and_mad(residual: NDArray[np.floating]) -> tuple[float, float]:
    """Return median and median absolute deviation of the residuals that are not NaN (eq. 12)."""
    seen = residual[~np.isnan(residual)]
    median = float(np.median(seen))
    return median, float(np.median(np.abs(seen - median)))


def huber_weights(residual: NDArray[np.floating], median: float, bound: float) -> NDArray[np.floating]:
    """Return psi(d) / d for d = residual - median, Huber's psi with its bound in grey levels (eq. 34)."""
    off = np.abs(residual - median)
    return np.where(off <= bound, 1.0, bound / np.maximum(off, bound))


def weigh(residual: NDArray[np.floating], huber: float, min_sigma: float) -> tuple[NDArray[np.floating], float]:
    """Return Huber's weights over the variance, and its root sigma; his bound is `huber` sigma (eq. 33-35)."""
    median, mad = median_and_mad(residual)
    sigma = max(SIGMA_OF_MAD * mad, min_sigma)
    return huber_weights(residual, median, huber * sigma) / sigma**2, sigma
