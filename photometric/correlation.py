"""How many pixels count as one independent observation, measured by how differently parts of the image pull."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photometric import kernels
from photometric.normal_equations import NormalEquations, ViewSolver

Array = NDArray[np.float64]
MIN_PIECES = 2  # of a view; fewer do not scatter
FIRST_OF_ROW = np.cumsum([0, *range(kernels.NUM_COLUMNS + 1, 1, -1)])  # of the rows of the upper triangle in the sums
UPPER = np.triu_indices(kernels.NUM_COLUMNS + 1)


def correlated_pixels(solvers: Sequence[ViewSolver], found: Sequence[NormalEquations], otherwise: float) -> float:
    """Return the number of pixels that err together, 1 where all residuals are independent.

    The pixels of a view are summed in pieces of scan order. Were residuals independent, the gradient g of a piece would
    scatter by sigma^2 H of that piece, so that the sum of g' H^-1 g / sigma^2 over all pieces, H of the whole view,
    would be 8 (pose, gain and bias), less what the fit takes away. Correlation multiplies it (the scalar form of
    cluster-robust covariance). `otherwise` is returned where there are too few pieces.
    """
    total = expected = 0.0
    for solver, view in zip(solvers, found, strict=True):
        pieces = solver.piece_sums()
        if len(pieces) < MIN_PIECES or not np.all(np.isfinite(pieces)):
            continue
        H = np.zeros((kernels.NUM_COLUMNS + 1, kernels.NUM_COLUMNS + 1))
        H[UPPER] = pieces.sum(axis=0)[: UPPER[0].size]
        H = (H + np.triu(H, 1).T)[:-1, :-1]
        g = pieces[:, FIRST_OF_ROW[1:] - 1]
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(H), 1e-300))
        solved = np.linalg.lstsq(H * np.outer(scale, scale), (g * scale).T, rcond=None)[0]
        total += float(np.sum((g * scale).T * solved)) / view.sigma**2
        expected += kernels.NUM_COLUMNS * (1.0 - 1.0 / len(pieces))
    return max(1.0, total / expected) if expected else otherwise
