"""Covariances of estimates from observations that err together.

Neighbouring pixels, corners and directions of one image err alike: N of them tell as much as N / n independent ones,
where n observations *count as one*. Where there are parts that are independent of each other, the scatter of their
gradients measures it (`clustered_covariance`); else n is a constant named CORRELATED_... beside its use, and multiplies
the variance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Array, Integers

Floats = NDArray[np.floating]


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
