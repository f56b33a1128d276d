"""The cells of a map that every image is compared with while no place is held."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.motion_model import wrap_angle
from mcl_depth.constants import MAX_CELLS
from mcl_depth.likeness.depth_map import DepthMap
from sphere_nav.geometry.arrays import Array


class SurveyGrid:
    """The cells of a map that are compared with every image: all of them, or a coarser grid of a large map."""

    def __init__(self, depth_map: DepthMap, middles: Array) -> None:
        """`middles` (K, 2) m of the area; at most `MAX_CELLS` cells, and no more than the depth cache holds."""
        cells = np.unique(depth_map.cells(middles), axis=0)
        limit = min(MAX_CELLS, max(int(0.8 * depth_map.cache.capacity), 1))
        stride = 1
        while len(np.unique(cells // stride, axis=0)) > limit:
            stride += 1
        off_middle = np.abs(cells % stride - stride // 2).sum(axis=1)
        nearest = cells[np.argsort(off_middle, kind="stable")]
        coarse, first = np.unique(nearest // stride, axis=0, return_index=True)
        chosen = nearest[first]
        self.edge, self.diagonal = depth_map.edge * stride, float(np.sqrt(2.0)) * depth_map.edge  # m, of a cell
        self.positions = (chosen + 0.5) * depth_map.edge  # (K, 2) m, compared
        self._low = coarse.min(axis=0)
        self.index = coarse - self._low  # (K, 2)
        self.shape = tuple(int(n) for n in self.index.max(axis=0) + 1)
        self._rows = np.full(self.shape, -1)
        self._rows[tuple(self.index.T)] = np.arange(len(self.positions))
        self.mask = self._rows >= 0

    def rows_around(self, pose: Array, reach: int) -> NDArray[np.int64]:
        """Return which positions lie within `reach` cells of a pose (3,), (2 reach + 1, 2 reach + 1); -1: none."""
        side = 2 * reach + 1
        first = np.floor(pose[:2] / self.edge).astype(np.int64) - self._low - reach
        x, y = np.clip(first, -side, self.shape) + side
        return np.pad(self._rows, side, constant_values=-1)[x : x + side, y : y + side]

    def poses_of(self, places: NDArray[np.int64], num_headings: int) -> Array:
        """Return the poses (N, 3) of elements (N, 3) of a field: heading, x, y."""
        xy = (places[:, 1:] + self._low + 0.5) * self.edge
        return np.column_stack([xy, wrap_angle(2.0 * np.pi * places[:, 0] / num_headings)])
