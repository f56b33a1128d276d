"""One visual image and the depth images it is compared with: a place once (algorithm 2, S_cache)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness.depth_map import DepthMap
from mcl_depth.likeness.kinds import Visual
from sphere_nav.geometry.arrays import Array


class Comparison:
    """One visual image against the map; a place is compared once, however many particles are there."""

    def __init__(self, visual: Visual, depth_map: DepthMap, num_headings: int) -> None:
        self._visual, self._map, self._num_headings = visual, depth_map, num_headings

    def curves(self, positions: Array) -> NDArray[np.float32]:
        """Return the similarities (N, A) of all headings at positions (N, 2) in m; 0 where the map has no ground."""
        cells, place = np.unique(self._map.cells(positions), axis=0, return_inverse=True)
        return self._map.similarities(self._visual, cells, self._num_headings)[place.ravel()]

    def survey(self, rows: NDArray[np.int64] | None = None) -> NDArray[np.float32]:
        """Return how well the image fits at all places of the survey, or some rows of them, (N, A), in its units."""
        found: NDArray[np.float32] = self._map.survey.curves(self._visual, self._num_headings, rows)
        return found
