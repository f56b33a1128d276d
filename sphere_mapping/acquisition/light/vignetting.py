"""How the lenses of a rig darken towards their rims, and the gain of each exposure, from what cameras share.

Where cameras a and b see the same point under the angles t_a, t_b from their axes, its levels I there are those of
one radiance: log I_a - log I_b = e_a - e_b + V_a(t_a) - V_b(t_b), with the exposures e and the falloff
V(t) = c_1 s + c_2 s^2 + c_3 s^3, s = (t / t_max)^2 of a lens, no c above 0: no lens brightens towards its rim (Goldman
2010, eq. 3, in logarithms). The falloff is the camera's, the same in all colours and at all times; exposures are one of
each group and instant. Both are estimated at once by robust least squares, the falloff from the first instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.sparse import csr_array

from sphere_mapping.acquisition.constants import (
    CORRELATED_DIRECTIONS,
    EXPOSURE_STD,
    FALLOFF_STD,
    LEAST_COEFFICIENT,
    LEVEL_STD,
    LIKE_STD,
    LOSS_SCALES,
    RATIO_STD,
)
from sphere_nav.geometry.arrays import Array

NUM_POWERS = 3


@dataclass(frozen=True, eq=False)
class PairRatios:
    """What two cameras say of one point each: numbers (N,) of cameras and exposures, s, log ratio and its deviation."""

    cameras: tuple[NDArray[np.intp], NDArray[np.intp]]
    exposures: tuple[NDArray[np.intp], NDArray[np.intp]]
    squares: tuple[Array, Array]
    ratio: Array
    std: Array


def std_of(first: Array, second: Array) -> Array:
    """Return the deviation (N,) of the logarithm of the ratio of grey levels (N,)."""
    return np.sqrt(RATIO_STD**2 + np.square(LEVEL_STD / first) + np.square(LEVEL_STD / second))


def falloff(coefficients: Array, squares: Array) -> Array:
    """Return V (...,) at s (...,), from coefficients (NUM_POWERS,)."""
    found = np.zeros_like(squares)
    for coefficient in coefficients[::-1]:
        found = (found + coefficient) * squares
    return found


class Falloff:
    """The falloff of all cameras: what instants have said of it so far, as a normal matrix.

    kinds: (number of cameras,), equal where lenses are of one kind.
    """

    def __init__(self, kinds: Sequence[object]) -> None:
        size = NUM_POWERS * len(kinds)
        self.coefficients = np.zeros((len(kinds), NUM_POWERS))
        self._matrix, self._vector = np.eye(size) / FALLOFF_STD**2, np.zeros(size)
        for a in range(len(kinds)):
            for b in range(a):
                if kinds[a] == kinds[b]:
                    self._couple(a, b)

    def _couple(self, a: int, b: int) -> None:
        for k in range(NUM_POWERS):
            row = np.zeros(len(self._vector))
            row[NUM_POWERS * a + k], row[NUM_POWERS * b + k] = 1.0, -1.0
            self._matrix += np.outer(row, row) / LIKE_STD**2

    def update(self, seen: PairRatios, num_exposures: int) -> None:
        """Add what an instant says; its exposures are eliminated."""
        size = len(self._vector)
        rows = csr_array(np.hstack([self._powers(seen), design(seen, num_exposures)]))  # at most 8 of a row are not 0
        prior = np.zeros((rows.shape[1], rows.shape[1]))
        prior[:size, :size] = self._matrix
        prior[size:, size:] = np.eye(num_exposures) / EXPOSURE_STD**2
        vector = np.concatenate([self._vector, np.zeros(num_exposures)])
        low = np.concatenate([np.full(size, LEAST_COEFFICIENT), np.full(num_exposures, -np.inf)])
        high = np.concatenate([np.zeros(size), np.full(num_exposures, np.inf)])
        values: Array = np.zeros(rows.shape[1])
        for scale in LOSS_SCALES:
            weight = weights(seen, rows @ values, scale)
            weighted = rows.multiply(weight[:, None]).T
            matrix = prior + (weighted @ rows).toarray()
            target = vector + weighted @ seen.ratio
            values = _solve(matrix, target, low, high)
        inner = np.linalg.solve(matrix[size:, size:], np.column_stack([matrix[size:, :size], target[size:]]))
        self._matrix = matrix[:size, :size] - matrix[:size, size:] @ inner[:, :-1]
        self._vector = target[:size] - matrix[:size, size:] @ inner[:, -1]
        self.coefficients = _solve(self._matrix, self._vector, low[:size], high[:size]).reshape(-1, NUM_POWERS)

    def exposures(self, seen: PairRatios, num_exposures: int) -> Array:
        """Return the logarithms (num_exposures,) of an instant's exposures, mean 0, as the falloff is known now."""
        rows = design(seen, num_exposures)
        ratio = seen.ratio - self._powers(seen) @ self.coefficients.ravel()
        values: Array = np.zeros(num_exposures)
        for scale in LOSS_SCALES:
            weight = weights(seen, rows @ values + seen.ratio - ratio, scale)
            matrix = np.eye(num_exposures) / EXPOSURE_STD**2 + (rows.T * weight) @ rows
            values = np.linalg.solve(matrix, (rows.T * weight) @ ratio).astype(np.float64)
        return values - values.mean()

    def _powers(self, seen: PairRatios) -> Array:
        """Return the derivatives (N, cameras * NUM_POWERS) of the ratios by all coefficients."""
        found = np.zeros((seen.ratio.size, len(self._vector)))
        at = np.arange(seen.ratio.size)
        for camera, square, sign in zip(seen.cameras, seen.squares, (1.0, -1.0), strict=True):
            for k in range(NUM_POWERS):
                found[at, NUM_POWERS * camera + k] += sign * square ** (k + 1)
        return found


def design(seen: PairRatios, num_exposures: int) -> Array:
    """Return the derivatives (N, num_exposures) of the ratios by the exposures; none within one exposure."""
    rows = np.zeros((seen.ratio.size, num_exposures))
    at = np.arange(seen.ratio.size)
    rows[at, seen.exposures[0]] += 1.0
    rows[at, seen.exposures[1]] -= 1.0
    return rows


def weights(seen: PairRatios, expected: Array, scale: float) -> Array:
    """Return the weight (N,) of each comparison, by Cauchy's loss."""
    errors = (seen.ratio - expected) / seen.std
    return 1.0 / (CORRELATED_DIRECTIONS * np.square(seen.std) * (1.0 + np.square(errors / scale)))


def _solve(matrix: Array, target: Array, low: Array, high: Array) -> Array:
    """Return the minimum of x' M x / 2 - t' x within bounds."""
    upper = np.linalg.cholesky(matrix).T
    return lsq_linear(upper, np.linalg.solve(upper.T, target), (low, high), method="bvls").x
