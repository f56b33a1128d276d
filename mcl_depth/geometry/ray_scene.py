"""Range panoramas of triangles by ray casting (Embree)."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from mcl_depth.geometry.mesh import TriangleMesh
from mcl_depth.image_params import SynthesisParams
from sphere_geometry import Spherical
from sphere_geometry.camera import pixel_grid

Image = NDArray[np.float32]
NO_HIT = -1


class RayScene:
    """A mesh, and the rays of one panorama."""

    def __init__(self, mesh: TriangleMesh, camera: Spherical, params: SynthesisParams) -> None:
        self._params = params
        self._shape = (camera.height, camera.width)
        self._rays = np.ascontiguousarray(camera.unproject(pixel_grid(camera)).reshape(-1, 3), np.float32)
        self._scene = EmbreeScene(robust=True)
        self._keep = EmbreeMesh(self._scene, mesh.vertices[mesh.triangles])
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree, not thread-safe
        self._pool = ThreadPoolExecutor(max_workers=os.cpu_count() or 1)

    def ranges(self, positions_map: NDArray[np.float64]) -> Image:
        """Return ranges (M, H, W) in m around places (M, 3); NaN where a ray meets nothing."""
        out = np.empty((len(positions_map), *self._shape), np.float32)
        list(self._pool.map(lambda i: self._cast(positions_map[i], out[i]), range(len(out))))
        return out

    def _cast(self, position: NDArray[np.float64], out: Image) -> None:
        starts = np.empty_like(self._rays)
        starts[:] = position
        found = self._scene.run(starts, self._rays, query="INTERSECT", output=1)
        is_known = (found["primID"] != NO_HIT) & (found["tfar"] <= self._params.max_range_m)
        out[:] = np.where(is_known, found["tfar"], np.float32(np.nan)).reshape(out.shape)
