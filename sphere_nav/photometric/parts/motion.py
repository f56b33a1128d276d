"""The motion on which most parts of a view agree, by how far each of them is shifted (RANSAC).

Where a pose is some pixels off, no cell agrees without a shift, and an alignment of all pixels may be drawn away by
what has changed. But the cells that show the map are all shifted as one motion shifts them. So motions are fitted to
sets of three cells, and the one on which most cells agree is taken. Whether as many could agree by chance is for the
votes there to say, each set counted as one try.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.normal_equations import scaled_inverse
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.photometric.align.judgement import UNKNOWN
from sphere_nav.photometric.constants import FITTED_CELLS, MIN_SHIFT_SIGMA_PX, NEAR_SHIFT, NUM_TRIED_MOTIONS
from sphere_nav.photometric.parts.votes import Shifts

SINGULAR = 1e-6  # of the curvature: below it three cells say nothing of a direction


def fit_motion(cells: Shifts) -> Array | None:
    """Return xi (6,) that shifts as many cells as possible as they are shifted; None where there are too few."""
    if cells.number <= FITTED_CELLS:
        return None
    tries = _draw(cells.number)
    J, shift = cells.by_pose[tries].reshape(len(tries), -1, 6), cells.shift[tries].reshape(len(tries), -1)
    size = np.sqrt(np.mean(J**2, axis=1, keepdims=True)) + TINY  # meters and radians are not alike
    J = J / size
    H = np.swapaxes(J, 1, 2) @ J + SINGULAR * np.eye(6)
    motions = np.linalg.solve(H, np.swapaxes(J, 1, 2) @ shift[..., None])[..., 0] / size[:, 0]
    counts = agreeing(cells, motions).sum(axis=1)
    agrees = agreeing(cells, motions[[np.argmax(counts)]])[0]
    if agrees.sum() <= FITTED_CELLS:
        return None
    J, shift = cells.by_pose[agrees].reshape(-1, 6), cells.shift[agrees].reshape(-1)
    return np.asarray(scaled_inverse(J.T @ J) @ J.T @ shift)


@lru_cache(16)
def _draw(number: int) -> NDArray[np.int64]:
    """Return sets of three of so many cells, always the same."""
    order = np.argsort(np.random.default_rng(0).random((NUM_TRIED_MOTIONS, number)), axis=1)
    return np.asarray(order[:, :FITTED_CELLS])


def motion_covariance(cells: Shifts) -> Array:
    """Return the covariance (6, 6) of a pose at which cells are shifted so, by those that agree there."""
    agrees = agreeing(cells, np.zeros((1, 6)))[0]
    if agrees.sum() <= FITTED_CELLS:
        return UNKNOWN.copy()
    J, shift = cells.by_pose[agrees].reshape(-1, 6), cells.shift[agrees].reshape(-1)
    variance = max(float(np.mean(shift**2)), MIN_SHIFT_SIGMA_PX**2)
    return np.asarray(variance * scaled_inverse(J.T @ J))


def agreeing(cells: Shifts, motions: Array) -> NDArray[np.bool_]:
    """Return which of N cells each of M motions shifts as they are shifted, (M, N)."""
    off = np.einsum("nij,mj->mni", cells.by_pose, motions) - cells.shift
    return np.asarray(np.abs(off).max(axis=2) <= NEAR_SHIFT)
