"""What the map looks like from a place: the range along every ray of a level panorama (N17 section III-A)."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mcl_depth.constants import ELEVATIONS_DEG, MIN_DENSE_SHARE
from mcl_depth.geometry.cloud import Geometry
from mcl_depth.geometry.mesh import RayScene
from mcl_depth.geometry.splats import Splats
from mcl_depth.geometry.surfels import surfels_of
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical

Image = NDArray[np.float32]


def panorama_window(params: SynthesisParams) -> Spherical:
    """Return the window of the sphere, all around between two elevations, that is synthesised."""
    low, high = ELEVATIONS_DEG
    full_height = params.num_columns / 2
    height = round((high - low) / 180.0 * full_height)
    top = (0.5 - high / 180.0) * full_height
    return Spherical(params.num_columns, height, float(params.num_columns), 0.0, top)


class DepthSynthesizer:
    """Draws range panoramas of a cloud or a mesh; body axes parallel to the map's (yaw 0).

    Rays meet surfaces, also those that dense points are; single points are drawn as splats.
    """

    def __init__(self, geometry: Geometry, params: SynthesisParams) -> None:
        self.camera = panorama_window(params)
        self._geometry, self._params = geometry, params

    @cached_property
    def _scene(self) -> Splats | RayScene:
        """What draws; made when the first panorama is asked for: a map whose panoramas are on disk needs none."""
        geometry, camera, params = self._geometry, self.camera, self._params
        if geometry.is_mesh:
            return RayScene(geometry, camera, params)
        surfels, dense_share = surfels_of(geometry, params.voxel_m)
        if dense_share >= MIN_DENSE_SHARE:
            return RayScene(surfels, camera, params)
        return Splats(geometry, camera, params)

    def synthesize_many(self, positions_map: ArrayLike) -> Image:
        """Return ranges (M, H, W) in m around places (M, 3); in parallel."""
        return self._scene.ranges(np.asarray(positions_map, np.float64))
