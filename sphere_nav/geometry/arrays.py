"""What arrays of numbers are called in signatures (shapes and units stand in the docstrings), and how they are used."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y, yaw of the covariance of a tangent vector (v, omega)
TINY = 1e-12  # keeps divisors from 0; nothing that is measured is as small
