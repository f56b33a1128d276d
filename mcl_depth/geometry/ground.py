"""How high the ground lies: the lowest surface of the map in a grid, smoothed over holes nearby."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from mcl_depth.constants import GROUND_REACH, GROUND_STEP, MAX_ELEMENTS
from sphere_nav.geometry.arrays import Array


class Ground:
    """Height of the ground under (x, y), from points (N, 3) of the map."""

    def __init__(self, points: NDArray[np.floating], step: float = GROUND_STEP) -> None:
        self._step = step
        self._low = points[:, :2].min(axis=0).astype(np.float64)
        cells = np.floor((points[:, :2] - self._low) / step).astype(np.int64)
        shape = cells.max(axis=0) + 1
        if shape.prod() > MAX_ELEMENTS:
            raise ValueError(f"ground: expected at most {MAX_ELEMENTS} squares of {step:g} m, found {shape.tolist()}")
        lowest = np.full(shape, np.inf)
        np.minimum.at(lowest, (cells[:, 0], cells[:, 1]), points[:, 2])
        self._heights = _fill(lowest, step)

    def heights(self, positions: Array) -> Array:
        """Return the height (N,) m of the ground at (N, 2), bilinear; NaN where the map has no ground."""
        place = (positions - self._low) / self._step - 0.5
        first = np.floor(place).astype(np.int64)
        share = place - first
        limit = np.array(self._heights.shape) - 1
        total, weight = np.zeros(len(positions)), np.zeros(len(positions))
        for dx in (0, 1):
            for dy in (0, 1):
                cell = np.clip(first + np.array([dx, dy]), 0, limit)
                value = self._heights[cell[:, 0], cell[:, 1]]
                part = np.abs(1 - dx - share[:, 0]) * np.abs(1 - dy - share[:, 1])
                known = np.isfinite(value)
                total += np.where(known, part * np.where(known, value, 0.0), 0.0)
                weight += np.where(known, part, 0.0)
        outside = np.any((place < -1.0) | (place > limit + 1.0), axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where((weight > 1e-3) & ~outside, total / weight, np.nan)


def _fill(lowest: Array, step: float) -> Array:
    """Return the grid with holes filled from the nearest square within reach; the rest NaN."""
    is_empty = ~np.isfinite(lowest)
    distance, nearest = distance_transform_edt(is_empty, return_indices=True)
    filled = lowest[nearest[0], nearest[1]]
    filled[distance * step > GROUND_REACH] = np.nan
    return filled
