"""Poses at a stamp: interpolated; those of odometry carried on (or back) by its own speed for a short time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from math import inf
from operator import itemgetter
from typing import TypeVar

import numpy as np

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.se3 import SE3

MEMORY_NS = 10_000_000_000  # as tf2 keeps transforms; a stamp by more before the last is of a clock that was set back
NO_TWIST = np.zeros(6)


T = TypeVar("T")


def move_on(before: SE3, after: SE3, share: float) -> SE3:
    """Return the pose after a share of a steady motion; beyond 1 it goes on."""
    return before @ SE3.exp(share * (before.inverse() @ after).log())


class PoseBuffer(deque[tuple[int, SE3, T]]):
    """Poses by growing stamps in ns, each with what else is known of it."""

    def at(self, stamp_ns: int, max_gap_ns: float = inf) -> tuple[SE3, T] | None:
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
