"""What the map looks like from a place: the range along every ray of a level panorama (N17 section III-A)."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mcl_depth.constants import ELEVATIONS_DEG, MIN_DENSE_SHARE
from mcl_depth.geometry.cloud import Cloud
from mcl_depth.geometry.columns.voxel_map import voxel_map
from mcl_depth.geometry.columns.walker import Walker
from mcl_depth.geometry.mesh import RayScene, TriangleMesh
from mcl_depth.geometry.point_index import PointIndex
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical

Image = NDArray[np.float32]


def panorama_window(params: SynthesisParams) -> Spherical:
    """Return the window of the sphere, all around between two elevations, that is synthesised."""
    low, high = ELEVATIONS_DEG
    full_height = params.num_columns / 2
    height = round((high - low) / 180.0 * full_height)
    if height < 3:
        raise ValueError(f"elevations: expected a panorama of at least 3 rows, found {low:g} to {high:g} deg")
    if params.num_columns % 2 == 0 and height == full_height:
        return Spherical(params.num_columns, height)
    top = (0.5 - high / 180.0) * full_height
    return Spherical(params.num_columns, height, float(params.num_columns), 0.0, top)


class DepthSynthesizer:
    """Draws range panoramas of a cloud or a mesh; body axes parallel to the map's (yaw 0).

    Dense points are drawn as columns of voxels, single ones as splats; `drawing` (columns, splats) insists on one.
    """

    def __init__(
        self, geometry: Cloud | TriangleMesh, params: SynthesisParams | None = None, drawing: str = "auto"
    ) -> None:
        self.params = params or SynthesisParams()
        self.camera = panorama_window(self.params)
        self._geometry, self._drawing = geometry, drawing

    @cached_property
    def _scene(self) -> Walker | PointIndex | RayScene:
        """What draws; made when the first panorama is asked for: a map whose panoramas are on disk needs none."""
        return _scene(self._geometry, self.camera, self.params, self._drawing)

    def synthesize_many(self, positions_map: ArrayLike) -> Image:
        """Return ranges (M, H, W) in m around places (M, 3); in parallel."""
        positions = np.asarray(positions_map, np.float64)
        if positions.ndim != 2 or positions.shape[1] != 3 or not np.all(np.isfinite(positions)):
            raise ValueError(f"positions: expected finite (M, 3), found shape {positions.shape}")
        return self._scene.ranges(positions)


def _scene(
    geometry: Cloud | TriangleMesh, camera: Spherical, params: SynthesisParams, drawing: str
) -> Walker | PointIndex | RayScene:
    """Return what draws a geometry: rays for surfaces, columns for dense points, splats for single ones."""
    if isinstance(geometry, TriangleMesh):
        return RayScene(geometry, camera, params)
    if drawing != "splats" and len(geometry):
        levels = Walker.num_levels(params.voxel_m, camera, params)
        voxels = voxel_map(geometry, params.voxel_m, levels)
        if drawing == "columns" or voxels.dense_share >= MIN_DENSE_SHARE:
            return Walker(voxels, camera, params)
    return PointIndex(geometry, camera, params)
