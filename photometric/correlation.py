"""How many pixels count as one independent observation, measured by how differently parts of the image pull."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photometric.descent import kernels
from photometric.iteration.kernels import NUM_COLUMNS
from photometric.problem import Comparison

MIN_PIECES = 2  # of a view; fewer do not scatter


def correlated_pixels(found: Sequence[Comparison], otherwise: float) -> float:
    """Return the number of pixels that err together, 1 where all residuals are independent.

    The pixels of a view are summed in pieces of scan order. Were residuals independent, the gradient g of a piece would
    scatter by sigma^2 H of that piece, so that the sum of g' H^-1 g / sigma^2 over all pieces, H of the whole view,
    would be 8 (pose, gain and bias), less what the fit takes away. Correlation multiplies it (the scalar form of
    cluster-robust covariance). `otherwise` is returned where there are too few pieces.
    """
    total = expected = 0.0
    for view in found:
        if len(view.pieces) >= MIN_PIECES and np.all(np.isfinite(view.pieces)):
            total += kernels.scatter(view.pieces, view.sigma)
            expected += NUM_COLUMNS * (1.0 - 1.0 / len(view.pieces))
    return max(1.0, total / expected) if expected else otherwise
