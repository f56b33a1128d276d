"""Which pixels are worth aligning: those that fix the six degrees of freedom best (M15 section 3.6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photometric import kernels


def saliency_rank(
    points: NDArray[np.float32], gradient: NDArray[np.float32], limit: int | None = None
) -> NDArray[np.int32]:
    """Return the place (N,) of each pixel in the order of algorithm 1: 0 is the most salient.

    points (3, N) m and gradient (3, N) in grey levels per metre, both in the reference frame. The six
    steepest-descent columns J = [gradient, point x gradient] pick their best remaining pixel in turn, for the first
    `limit` places; the others follow in the order of the image.
    """
    number = points.shape[1]
    order = np.empty((6, min(limit or number, number)), np.uint32)
    kernels.sort_columns(points, gradient, np.empty((6, number), np.uint16), order)
    rank = np.empty(number, np.int32)
    kernels.pick_in_turn(order, rank)
    return rank
