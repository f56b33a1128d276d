"""How well the gradients of pixels agree with an image that is shifted: compiled, as every pixel meets every shift."""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit


@njit(**OPTIONS)
def score_shifts(image, column, row, direction, weight, cell, reach, scores):
    """Add weight times cosine of every pixel to scores (cells, 2 reach + 1, 2 reach + 1) f64 of its cell, each shift.

    The pixels at column, row (N,) i32 of an image (H, W) lie more than `reach` within it; direction (N, 2) f32 is the
    unit gradient that each should have there, weight (N,) f32 what it counts. NaN and even parts of the image add 0.
    """
    for k in range(column.size):
        du, dv, share, own = direction[k, 0], direction[k, 1], weight[k], scores[cell[k]]
        for i in range(2 * reach + 1):
            y = row[k] + i - reach
            for j in range(2 * reach + 1):
                x = column[k] + j - reach
                gu = np.float32(image[y, x + 1]) - np.float32(image[y, x - 1])
                gv = np.float32(image[y + 1, x]) - np.float32(image[y - 1, x])
                square = gu * gu + gv * gv
                if square > np.float32(0.0):  # false for NaN too
                    own[i, j] += share * (du * gu + dv * gv) / math.sqrt(square)
