"""Range panoramas of single points: ever coarser copies of a cloud, drawn as splats, the closest wins.

At a distance the copy is drawn whose spacing is just below the width of a pixel there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import COARSENESS, NEAREST_M, SPLAT
from mcl_depth.geometry import kernels
from mcl_depth.geometry.cloud import Geometry
from mcl_depth.geometry.surfels import means_of
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical

Image = NDArray[np.float32]


class Splats:
    """A cloud in copies; each has voxels of twice the size of those before."""

    def __init__(self, cloud: Geometry, camera: Spherical, params: SynthesisParams) -> None:
        self._camera = camera
        pixel = COARSENESS * 2.0 * np.pi / camera.full_width
        number = max(int(np.ceil(np.log2(params.max_range_m * pixel / params.voxel_m))), 1)
        sizes = params.voxel_m * 2.0 ** np.arange(number)
        copies = [means_of(cloud.points.astype(np.float64), sizes[0], cloud.name)]
        for size in sizes[1:]:
            copies.append(means_of(copies[-1], size, cloud.name))
        self._points = np.concatenate(copies).astype(np.float32)
        self._starts = np.cumsum([0, *map(len, copies)])
        self._sizes = sizes.astype(np.float32)
        self._edges = np.array([NEAREST_M, *(sizes[1:] / pixel), params.max_range_m], np.float32)

    def ranges(self, positions_map: NDArray[np.float64]) -> Image:
        """Return ranges (M, H, W) in m around places (M, 3); NaN where no point is drawn."""
        camera, places = self._camera, positions_map.astype(np.float32)
        window = np.array([camera.full_width, camera.offset_v], np.float32)
        out = np.empty((len(places), camera.height, camera.width), np.float32)
        return kernels.draw_many(places, self._points, self._starts, self._sizes, self._edges, window, SPLAT, out)
