"""Surveys that are larger than memory: tiles of a folder, points that are thinned while they are read.

A county comes as tiles of a square kilometre with fifty million points each. No more than `MAX_KEPT` points are held
at any time: where more come, one of every cube is kept, and the cubes grow until no more than half are left. The
unit of the points does not matter; their order, that of the names and of the files, does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import FINEST_SHARE, GROWTH, INDEX_BITS, MAX_KEPT
from mcl_depth.geometry.cloud import cube_keys
from sphere_nav.geometry.arrays import Array


class Thinner:
    """Keeps at most so many points of a stream, evenly over space."""

    def __init__(self, box: Array | None = None, most: int = MAX_KEPT) -> None:
        """`box` (x0, y0, x1, y1), in the unit of the points, is all that counts."""
        self._box, self._most = box, most
        self._parts: list[NDArray[np.float64]] = []
        self._num_kept = 0
        self._corner = np.zeros(3)
        self.side = 0.0  # of a cube that one point is kept of, in the unit of the points; 0: all are kept

    def add(self, points: NDArray[Any]) -> None:
        """Take points (N, 3) into account."""
        points = np.asarray(points, dtype=np.float64)
        if self._box is not None:
            points = points[in_box(points, self._box)]
        for first in range(0, len(points), self._most // 2):
            self._parts.append(points[first : first + self._most // 2])
            self._num_kept += len(self._parts[-1])
            if self._num_kept > self._most:
                self._thin(self._most // 2)

    def points(self) -> NDArray[np.float64]:
        """Return what is kept, (N, 3), in the order in which it came."""
        if self.side > 0.0 and len(self._parts) > 1:  # the last ones as thin as the first
            self._thin(self._most)
        return np.concatenate([np.zeros((0, 3)), *self._parts])

    def _thin(self, limit: int) -> None:
        """Keep the first point of every cube, so wide that no more than so many are left; NaN and infinity go."""
        points = np.concatenate(self._parts)
        points = points[np.isfinite(points).all(axis=1)]
        if self.side == 0.0 and len(points):
            self._corner = points.min(axis=0)
            self.side = FINEST_SHARE * float(np.ptp(points, axis=0).max()) or 1.0  # of one point alone any will do
        farthest = float(np.abs(points - self._corner).max(initial=0.0))
        self.side = max(self.side, 2.0**-INDEX_BITS * 2.0 * farthest)  # so that all cubes have a number
        kept = self._first_of_cubes(points)
        while len(kept) > limit:
            self.side *= GROWTH
            kept = self._first_of_cubes(points)
        self._parts, self._num_kept = [kept], len(kept)

    def _first_of_cubes(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (N, 3) that are the first in their cube, in their order."""
        keys = cube_keys(points, self._corner, self.side)
        return points[np.sort(np.unique(keys, return_index=True)[1])]


def in_box(points: NDArray[np.floating], box: Array) -> NDArray[np.bool_]:
    """Return which of the points (N, 3) lie in a box (x0, y0, x1, y1)."""
    return np.all((points[:, :2] >= box[:2]) & (points[:, :2] <= box[2:]), axis=1)
