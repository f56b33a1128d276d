"""Do two localisers say the same? Poses of one body from two sources, compared at one time with both covariances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sphere_nav.geometry.arrays import PLANAR, Array
from sphere_nav.geometry.odometry import PoseBuffer
from sphere_nav.geometry.se3 import SE3

LIMIT = math.sqrt(16.266)  # chi^2 of three degrees of freedom, 99.9 %
MEMORY = 100  # poses of each source


@dataclass(frozen=True)
class Difference:
    """How far one pose is from the other: Mahalanobis distance over x, y and yaw, metres, radians."""

    distance: float
    meters: float
    radians: float

    @property
    def is_contradiction(self) -> bool:
        """Whether it is beyond what both covariances allow in 999 of 1000 cases."""
        return self.distance > LIMIT

    def __str__(self) -> str:
        turn = math.degrees(self.radians)
        return f"{self.meters:.2f} m, {turn:.1f} deg apart: {self.distance:.1f} standard deviations, limit {LIMIT:.1f}"


class Agreement:
    """Remembers the poses of two sources, 0 and 1; stamps need not be the same, but must be `max_gap_s` close."""

    def __init__(self, max_gap_s: float = 1.0) -> None:
        self._max_gap_ns = round(max_gap_s * 1e9)
        self._sources = PoseBuffer[Array](maxlen=MEMORY), PoseBuffer[Array](maxlen=MEMORY)

    def clear(self) -> None:
        """Forget everything, as after a jump of the clock."""
        for source in self._sources:
            source.clear()

    def add(self, source: int, stamp_ns: int, pose: SE3, covariance: Array) -> Difference | None:
        """Take a pose with its local covariance (6, 6); return the difference where both are known at one time."""
        own, other = self._sources[source], self._sources[1 - source]
        if own and stamp_ns <= own[-1][0]:
            return None
        here = pose, np.asarray(covariance, dtype=np.float64)
        own.append((stamp_ns, *here))
        there = other.at(stamp_ns, self._max_gap_ns)
        if there is not None:
            return difference(*here, *there)
        for passed_ns, passed, passed_covariance in reversed(other):
            between = own.at(passed_ns, self._max_gap_ns)
            if between is not None:
                return difference(*between, passed, passed_covariance)
        return None


def difference(one: SE3, covariance: Array, other: SE3, other_covariance: Array) -> Difference:
    """Return how far `other` is from `one`; covariances (6, 6) are local, independent of each other."""
    T_one_other = one.inverse() @ other
    adjoint = T_one_other.adjoint()
    both = covariance + adjoint @ other_covariance @ adjoint.T
    step = T_one_other.log()[[0, 1, 5]]
    distance = math.sqrt(max(float(step @ np.linalg.pinv(both[PLANAR]) @ step), 0.0))
    return Difference(distance, float(np.hypot(step[0], step[1])), abs(float(step[2])))
