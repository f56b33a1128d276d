"""Least squares: scaled solves, robust weights, covariances of observations that err together, gates.

Unknowns have different units: rows and columns of H x = -g are scaled to a unit diagonal first. Weights are those that
the kernels are tested against (M15 eq. 33-35). A gate compares how far an error is from zero, in standard deviations,
with a quantile of chi^2.

Neighbouring pixels, corners and directions of one image err alike: N of them tell as much as N / n independent ones,
where n observations *count as one*. Where there are parts that are independent of each other, the scatter of their
gradients measures it (`clustered_covariance`); else n is a constant named CORRELATED_... beside its use, and multiplies
the variance.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import SIGMA_OF_MAD
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Integers

Floats = NDArray[np.floating]
RARE = 1e-3  # share of what belongs together that a gate turns away; test_least_squares


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


RIDGE = 1e-9  # of the unit diagonal: an unknown of which nothing is seen stays where it is
LEAST = 1e-100  # of a diagonal: what is not seen has a variance that is a number, beyond all others


def weighted_step(J: Array, residual: Array, weight: Array) -> Array:
    """Return x (N,) that minimizes sum w (r + J x)^2 for J (M, N), residuals (M,) and weights (M,)."""
    weighted = weight[:, None] * J
    return scaled_step(weighted.T @ J, weighted.T @ residual)


def scaled_step(H: Array, g: Array) -> Array:
    """Return x (N,) = -H^-1 g for H (N, N), positive semidefinite, and g (N,)."""
    scaled, scale = _scale(H)
    return np.asarray(scale * np.linalg.solve(scaled, -scale * g), np.float64)


def scaled_inverse(H: Array) -> Array:
    """Return H^-1 (N, N) of H (N, N), positive semidefinite."""
    scaled, scale = _scale(H)
    return np.asarray(scale[:, None] * np.linalg.inv(scaled) * scale, np.float64)


def _scale(H: Array) -> tuple[Array, Array]:
    """Return H with a unit diagonal and a ridge, and by what (N,) its rows and columns were multiplied."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(H), LEAST))
    scaled = scale[:, None] * H * scale
    scaled.flat[:: len(H) + 1] += RIDGE
    return scaled, scale


def inverse_and_condition(H: Array) -> tuple[Array, float]:
    """Return H^-1 (N, N) and the condition number of the scaled H; infinite both, where H is not positive definite."""
    nothing = np.diag(np.full(len(H), np.inf))
    if not np.all(np.isfinite(H)):
        return nothing, np.inf
    scale = np.sqrt(np.maximum(np.diagonal(H), LEAST))
    eigenvalues, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    if eigenvalues[0] <= 0:
        return nothing, np.inf
    inverse = (vectors / eigenvalues) @ vectors.T / np.outer(scale, scale)
    return inverse, float(eigenvalues[-1] / eigenvalues[0])


def symmetric_inverse(matrix: NDArray[np.floating]) -> Array:
    """Return the inverse of a symmetric matrix (N, N), symmetric to the last bit."""
    return symmetric(np.linalg.inv(matrix))


def symmetric(matrix: NDArray[np.floating]) -> Array:
    """Return a matrix (N, N) without what rounding has made unsymmetric."""
    return np.asarray((matrix + matrix.T) / 2, dtype=np.float64)


def clustered_covariance(
    inverse: Floats, gradients: Floats, cluster: Integers, num_fitted: int = 1, known: Floats | float = 0.0
) -> Array:
    """Return the covariance (P, P) of x = -H^-1 sum g, where observations of one cluster err together in any way.

    inverse (P, P) is H^-1, gradients (N, P) are those at the solution, cluster (N,) says to which of M independent ones
    each belongs, known (P, P) is the covariance of what was known beforehand in terms of its gradient:
    H^-1 (M / (M - num_fitted) sum g g' + known) H^-1, the g being those of clusters.
    """
    names, own = np.unique(cluster, return_inverse=True)
    pulls = np.zeros((len(names), len(inverse)))
    np.add.at(pulls, own, gradients)
    freedom = len(names) / max(len(names) - num_fitted, 1)
    return np.asarray(inverse @ (freedom * pulls.T @ pulls + known) @ inverse, np.float64)
