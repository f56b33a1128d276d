"""How far an error is from zero, in standard deviations: what a gate compares with a quantile of chi^2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]


def squared_mahalanobis(error: Floats, covariance: Floats) -> float:
    """Return e' C^-1 e of an error (N,) with covariance (N, N); chi^2 of N degrees of freedom where e is normal."""
    return float(error @ np.linalg.solve(covariance, error))
