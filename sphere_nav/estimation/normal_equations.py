"""Solving H x = -g where the unknowns have different units: rows and columns are scaled to a unit diagonal first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Array

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
