"""Poses at a stamp: interpolated; those of odometry carried on (or back) by its own speed for a short time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from math import inf
from operator import itemgetter
from typing import TypeVar

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.se3 import SE3

MEMORY = 200  # messages; 2 s at 100 Hz
SET_BACK_NS = 10_000_000_000  # by which a stamp before the last one is of a clock that was set back


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


class OdometryBuffer:
    """The latest poses of the base in the odometry frame."""

    def __init__(self, max_age_s: float) -> None:
        self._max_age_s = max_age_s
        self._poses = PoseBuffer[Array](maxlen=MEMORY)

    def __len__(self) -> int:
        return len(self._poses)

    def clear(self) -> None:
        """Forget everything."""
        self._poses.clear()

    def add(self, stamp_ns: int, T_odom_base: SE3, twist: Array) -> None:
        """Keep a pose and its twist (6,), (v, omega) in base axes; ValueError for a stamp that does not grow.

        One far before the last is of a clock that was set back: what was kept is forgotten.
        """
        if self._poses and stamp_ns < self._poses[-1][0] - SET_BACK_NS:
            self.clear()
        if self._poses and stamp_ns <= self._poses[-1][0]:
            last = self._poses[-1][0]
            raise ValueError(f"odometry stamp: expected later than {last * 1e-9:.3f} s, found {stamp_ns * 1e-9:.3f} s")
        self._poses.append((stamp_ns, T_odom_base, twist))

    def at(self, stamp_ns: int) -> SE3 | None:
        """Return T_odom_base at a stamp; None too long before the first message or after the last."""
        if not self._poses:
            return None
        known = self._poses.at(stamp_ns)
        if known is not None:
            return known[0]
        end_ns, T_odom_base, twist = self._poses[0 if stamp_ns < self._poses[0][0] else -1]
        elapsed_s = (stamp_ns - end_ns) * 1e-9
        return T_odom_base @ SE3.exp(twist * elapsed_s) if abs(elapsed_s) <= self._max_age_s else None
