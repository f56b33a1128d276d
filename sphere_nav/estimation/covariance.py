"""Covariances of estimates from observations that err together.

Neighbouring pixels, corners and directions of one image err alike: N of them tell as much as N / n independent ones,
where n observations *count as one*. Where there are parts that are independent of each other, the scatter of their
gradients measures it (`clustered_covariance`); else n is a constant named CORRELATED_... beside its use, and multiplies
the variance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Array

Floats = NDArray[np.floating]


def clustered_covariance(inverse: Floats, gradients: Floats, known: Floats) -> Array:
    """Return the covariance (P, P) of x = -H^-1 sum g of M parts that are independent, whatever is within them.

    inverse (P, P) is H^-1, gradients (M, P) are those of the parts at the solution, known (P, P) the covariance of what
    was known beforehand in terms of its gradient: H^-1 (M / (M - 1) sum g g' + known) H^-1.
    """
    count = len(gradients)
    scatter = gradients.T @ gradients * count / (count - 1)
    return np.asarray(inverse @ (scatter + known) @ inverse, np.float64)
