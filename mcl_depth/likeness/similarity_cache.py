"""Similarities of one visual image with the depth images it was compared with (algorithm 2, S_cache)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness.depth_cache import Cell, keys_of
from mcl_depth.likeness.depth_map import DepthMap
from mcl_depth.likeness.kinds import Visual
from sphere_nav.geometry.arrays import Array


class Comparison:
    """One visual image against the map; a place is compared once, however many particles are there."""

    def __init__(self, visual: Visual, depth_map: DepthMap, num_headings: int) -> None:
        self._visual, self._map, self._num_headings = visual, depth_map, num_headings
        self._rows: dict[Cell, int] = {}
        self._curves = np.empty((0, num_headings), dtype=np.float32)
        self.num_asked, self.num_compared = 0, 0

    @property
    def mirrored(self) -> Comparison:
        """The same for the image in a mirror: left is right."""
        return Comparison(self._visual.mirrored, self._map, self._num_headings)

    @property
    def hit_rate(self) -> float:
        """Share of the questions that needed no comparison."""
        return 1.0 - self.num_compared / max(self.num_asked, 1)

    def curves(self, positions: Array) -> NDArray[np.float32]:
        """Return the similarities (N, A) of all headings at positions (N, 2) in m; 0 where the map has no ground."""
        cells = self._map.cells(positions)
        self.num_asked += len(cells)
        unique, place = np.unique(cells, axis=0, return_inverse=True)
        keys = keys_of(unique)
        missing = np.flatnonzero([key not in self._rows for key in keys])
        if len(missing):
            self.num_compared += len(missing)
            self._rows |= {keys[index]: len(self._rows) + number for number, index in enumerate(missing)}
            found = self._map.similarities(self._visual, unique[missing], self._num_headings)
            self._curves = np.concatenate([self._curves, found])
        rows = np.array([self._rows[key] for key in keys], dtype=np.int64)
        return self._curves[rows[place.ravel()]]

    def survey(self, positions: Array, rows: NDArray[np.int64] | None = None) -> NDArray[np.float32]:
        """Return how well the image fits at positions (N, 2) m, or some rows of them, (N, A), in units of its own."""
        found: NDArray[np.float32] = self._map.prepare(positions).curves(self._visual, self._num_headings, rows)
        return found
