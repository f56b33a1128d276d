"""Constants and steps of estimation that compiled code uses, too."""

import math

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit

SIGMA_OF_MAD = 1.4826  # 1 / Phi^-1(0.75), normal distribution (M15 eq. 35)


@njit(**OPTIONS)
def newton_step(H, g, first):
    """Return -H^-1 g by Cholesky of the scaled matrix, and whether H is positive definite.

    The rows and columns before `first` are left out.
    """
    n = g.size - first
    s, L, x = np.empty(n), np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        if not (H[first + i, first + i] > 0 and H[first + i, first + i] < np.inf):
            return x, False
        s[i] = 1 / math.sqrt(H[first + i, first + i])
    for i in range(n):
        for j in range(i + 1):
            t = H[first + i, first + j] * s[i] * s[j]
            for k in range(j):
                t -= L[i, k] * L[j, k]
            if i != j:
                L[i, j] = t / L[j, j]
            elif t > 0:
                L[i, i] = math.sqrt(t)
            else:
                return x, False
    for i in range(n):
        t = -g[first + i] * s[i]
        for k in range(i):
            t -= L[i, k] * x[k]
        x[i] = t / L[i, i]
    for i in range(n - 1, -1, -1):
        t = x[i]
        for k in range(i + 1, n):
            t -= L[k, i] * x[k]
        x[i] = t / L[i, i]
    is_finite = True
    for i in range(n):
        x[i] *= s[i]
        is_finite &= abs(x[i]) < np.inf
    return x, is_finite
