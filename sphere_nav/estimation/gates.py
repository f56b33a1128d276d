"""How far an error is from zero, in standard deviations: what a gate compares with a quantile of chi^2."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3

Floats = NDArray[np.floating]
RARE = 1e-3  # share of what belongs together that a gate turns away; test_gates


@cache
def gate(dof: int, rate: float = RARE) -> float:
    """Return the squared distance of so many degrees of freedom that chance exceeds at a rate."""
    from scipy.special import chdtri  # what only reads bags does without it

    return float(chdtri(dof, rate))


def squared_mahalanobis(error: Floats, covariance: Floats) -> float:
    """Return e' C^-1 e of an error (N,) with covariance (N, N); chi^2 of N degrees of freedom where e is normal."""
    return float(error @ np.linalg.solve(covariance, error))


def squared_distance(T_a: SE3, T_b: SE3, covariance: Floats) -> float:
    """Return how far two poses are apart as `squared_mahalanobis` does: `covariance` (6, 6) of both, in axes of `T_a`.

    chi^2 of 6 degrees of freedom where they are one: the tangent vector (v, omega) of T_a^-1 T_b.
    """
    return squared_mahalanobis((T_a.inverse() @ T_b).log(), covariance)
