"""Range panoramas of a voxel map: every azimuth is walked outwards until nothing more can be seen.

A voxel is drawn at the rows between its highest and its lowest point, where its column is crossed; what is nearer
comes first and stays. Cells grow with the distance, so that they are 0.75 to 1.5 pixels wide.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import CELL, MAX_ELEVATION_DEG, NEAREST_M
from mcl_depth.geometry.columns import kernels
from mcl_depth.geometry.columns.voxel_map import VoxelMap
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical

Image = NDArray[np.float32]


class Walker:
    """Draws one window of the sphere, body axes parallel to the map's."""

    def __init__(self, voxels: VoxelMap, camera: Spherical, params: SynthesisParams) -> None:
        self._camera, self._corner = camera, voxels.corner
        self._pixel = np.float32(CELL * 2.0 * np.pi / camera.full_width)
        self._reach = np.array([NEAREST_M, params.max_range_m], np.float32)
        self._extent = (voxels.extent + voxels.levels[0].size).astype(np.float32)  # the last cells are whole, too
        self._lay_out(voxels)
        self._aim()

    @staticmethod
    def num_levels(size: float, camera: Spherical, params: SynthesisParams) -> int:
        """Return how many levels a walk as far as the maximum range uses."""
        pixel = CELL * 2.0 * np.pi / camera.full_width
        return max(int(np.ceil(np.log2(params.max_range_m * pixel / size))), 1)

    def ranges(self, positions_map: NDArray[np.float64]) -> Image:
        """Return ranges (M, H, W) in m around places (M, 3); NaN where nothing is met."""
        places = (positions_map - self._corner).astype(np.float32)
        out = np.empty((len(places), self._camera.height, self._camera.width), np.float32)
        return kernels.draw_columns(
            places, self._voxels, self._blocks, self._starts, self._tops, self._levels, self._sizes, self._extent,
            self._azimuths, self._slopes, self._rises, self._search, self._pixel, self._reach, out,
        )  # fmt: skip

    def _lay_out(self, voxels: VoxelMap) -> None:
        """Put all levels one after the other."""
        levels = voxels.levels
        self._voxels = np.concatenate([level.voxels for level in levels]).astype(np.float32)
        self._blocks = np.concatenate([level.grid.blocks.ravel() for level in levels])
        bases = np.cumsum([0, *(len(level.voxels) for level in levels)])
        starts = [level.grid.starts + np.int32(base) for level, base in zip(levels, bases[:-1], strict=True)]
        self._starts = np.concatenate(starts)
        self._tops = np.concatenate([level.grid.tops(level.voxels) for level in levels])
        blocks = np.cumsum([0, *(level.grid.blocks.size for level in levels)])[:-1]
        firsts = np.cumsum([0, *(len(part) for part in starts)])[:-1]
        shapes = [level.grid.blocks.shape for level in levels]
        self._levels = np.column_stack([blocks, firsts, shapes]).astype(np.int64)
        self._sizes = np.array([level.size for level in levels], np.float32)

    def _aim(self) -> None:
        """Prepare azimuths, slopes and the table from slopes to rows."""
        camera = self._camera
        columns, rows = np.arange(camera.width), np.arange(camera.height)
        rays = camera.unproject(np.stack([columns, np.zeros(camera.width)], axis=-1))
        self._azimuths = (rays[:, :2] / np.linalg.norm(rays[:, :2], axis=1, keepdims=True)).astype(np.float32)
        upright = camera.unproject(np.stack([np.zeros(camera.height), rows], axis=-1))[:, 2]
        steepest = np.radians(MAX_ELEVATION_DEG)
        elevations = np.clip(np.arcsin(np.clip(upright, -1.0, 1.0)), -steepest, steepest)
        self._slopes = np.tan(elevations).astype(np.float32)
        self._rises = (1.0 / np.cos(elevations)).astype(np.float32)
        edges = 2.0 * np.arange(1, kernels.NUM_SEARCH + 1) / kernels.NUM_SEARCH - 1.0
        steepest = edges / np.maximum(1.0 - np.abs(edges), 1e-9)  # undoes slope / (1 + |slope|)
        self._search = np.searchsorted(-self._slopes, -steepest - 1e-3 * np.abs(steepest)).astype(np.int64)
