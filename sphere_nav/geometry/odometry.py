"""Odometry at the stamp of an image: interpolated, or carried on (or back) by its own speed for a short time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3

MEMORY = 200  # messages; 2 s at 100 Hz
SET_BACK_NS = 10_000_000_000  # by which a stamp before the last one is of a clock that was set back


class OdometryBuffer:
    """The latest poses of the base in the odometry frame."""

    def __init__(self, max_age_s: float) -> None:
        self._max_age_s = max_age_s
        self._stamps: deque[int] = deque(maxlen=MEMORY)
        self._poses: deque[tuple[SE3, NDArray[np.float64]]] = deque(maxlen=MEMORY)

    def __len__(self) -> int:
        return len(self._stamps)

    def clear(self) -> None:
        """Forget everything."""
        self._stamps.clear()
        self._poses.clear()

    def add(self, stamp_ns: int, T_odom_base: SE3, twist: NDArray[np.float64]) -> None:
        """Keep a pose and its twist (6,), (v, omega) in base axes; ValueError for a stamp that does not grow.

        One far before the last is of a clock that was set back: what was kept is forgotten.
        """
        if self._stamps and stamp_ns < self._stamps[-1] - SET_BACK_NS:
            self.clear()
        if self._stamps and stamp_ns <= self._stamps[-1]:
            last = self._stamps[-1]
            raise ValueError(f"odometry stamp: expected later than {last * 1e-9:.3f} s, found {stamp_ns * 1e-9:.3f} s")
        self._stamps.append(stamp_ns)
        self._poses.append((T_odom_base, twist))

    def at(self, stamp_ns: int) -> SE3 | None:
        """Return T_odom_base at a stamp; None too long before the first message or after the last."""
        if not self._stamps:
            return None
        index = bisect_left(self._stamps, stamp_ns)
        if 0 < index < len(self._stamps):
            return self._between(index, stamp_ns)
        index = min(index, len(self._stamps) - 1)  # the first one or the last one is carried on by its speed
        elapsed_s = (stamp_ns - self._stamps[index]) * 1e-9
        if abs(elapsed_s) > self._max_age_s:
            return None
        T_odom_base, twist = self._poses[index]
        return T_odom_base @ SE3.exp(twist * elapsed_s)

    def _between(self, index: int, stamp_ns: int) -> SE3:
        after, _ = self._poses[index]
        if self._stamps[index] == stamp_ns:
            return after
        before, _ = self._poses[index - 1]
        share = (stamp_ns - self._stamps[index - 1]) / (self._stamps[index] - self._stamps[index - 1])
        return before @ SE3.exp(share * (before.inverse() @ after).log())
