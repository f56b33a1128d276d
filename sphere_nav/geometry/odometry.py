"""Poses at a stamp: interpolated; those of odometry carried on (or back) by its own speed for a short time.

Poses of one body from two sources are compared at one time, with both covariances: do they say the same?
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from operator import itemgetter
from typing import TypeVar

import numpy as np

from sphere_nav.geometry.arrays import PLANAR, Array
from sphere_nav.geometry.se3 import SE3

MEMORY_NS = 10_000_000_000  # as tf2 keeps transforms; a stamp by more before the last is of a clock that was set back
NO_TWIST = np.zeros(6)
LIMIT = math.sqrt(16.266)  # chi^2 of three degrees of freedom, 99.9 %
MEMORY = 100  # poses of each source that are compared

T = TypeVar("T")


def move_on(before: SE3, after: SE3, share: float) -> SE3:
    """Return the pose after a share of a steady motion; beyond 1 it goes on."""
    return before @ SE3.exp(share * (before.inverse() @ after).log())


class PoseBuffer(deque[tuple[int, SE3, T]]):
    """Poses by growing stamps in ns, each with what else is known of it."""

    def at(self, stamp_ns: int, max_gap_ns: float = math.inf) -> tuple[SE3, T] | None:
        """Return the pose at a stamp and what is known of the next one; None where there are none on both sides."""
        index = bisect_left(self, stamp_ns, key=itemgetter(0))
        if index == len(self):
            return None
        after_ns, after, known = self[index]
        if after_ns == stamp_ns:
            return after, known
        before_ns, before, _ = self[max(index - 1, 0)]
        if index == 0 or after_ns - before_ns > max_gap_ns:
            return None
        return move_on(before, after, (stamp_ns - before_ns) / (after_ns - before_ns)), known


class OdometryBuffer(PoseBuffer[Array]):
    """Where something was in the last seconds, and its twist (6,), (v, omega) in its own axes; zeros: not told."""

    def add(self, stamp_ns: int, pose: SE3, twist: Array = NO_TWIST) -> bool:
        """Keep a pose; return False for a stamp that does not grow.

        One far before the last is of a clock that was set back: what was kept is forgotten.
        """
        if self and stamp_ns <= self[-1][0]:
            if stamp_ns >= self[-1][0] - MEMORY_NS:
                return False
            self.clear()
        self.append((stamp_ns, pose, twist))
        while stamp_ns - self[0][0] > MEMORY_NS:
            self.popleft()
        return True

    def carry_on(self, stamp_ns: int, max_age_ns: int) -> SE3 | None:
        """Return the pose at a stamp, for a short time before the first and after the last, too: by its twist."""
        if not self:
            return None
        known = self.at(stamp_ns)
        if known is not None:
            return known[0]
        end_ns, pose, twist = self[0 if stamp_ns < self[0][0] else -1]
        elapsed_ns = stamp_ns - end_ns
        return pose @ SE3.exp(twist * elapsed_ns * 1e-9) if abs(elapsed_ns) <= max_age_ns else None


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
