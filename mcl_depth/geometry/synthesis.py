"""What the map looks like from a place: the range along every ray of a level panorama (N17 section III-A).

Rays meet surfaces, also those that dense points are: a triangle in the plane of each voxel, as wide as the voxels
around leave no gap. Single points are drawn as splats.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from mcl_depth.constants import (
    ELEVATIONS_DEG,
    INRADIUS,
    MIN_DENSE_SHARE,
    NEAR_VOXELS,
    NEAREST_M,
    NUM_NEIGHBORS,
    SPLAT,
)
from mcl_depth.geometry import kernels
from mcl_depth.geometry.cloud import Geometry, means_of
from mcl_depth.geometry.mesh import RayScene
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical

Image = NDArray[np.float32]

BATCH = 1 << 18  # voxels whose neighbours are held at once
CORNERS = np.radians([90.0, 210.0, 330.0])


def panorama_window(params: SynthesisParams) -> Spherical:
    """Return the window of the sphere, all around between two elevations, that is synthesised."""
    low, high = ELEVATIONS_DEG
    full_height = params.num_columns / 2
    height = round((high - low) / 180.0 * full_height)
    top = (0.5 - high / 180.0) * full_height
    return Spherical(params.num_columns, height, float(params.num_columns), 0.0, top)


class DepthSynthesizer:
    """Draws range panoramas of a cloud or a mesh; body axes parallel to the map's (yaw 0)."""

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


class Splats:
    """Single points: a cloud in copies, each of voxels of twice the size of those before; the closest point wins.

    At a distance the copy is drawn whose spacing is just below the width of a pixel there.
    """

    def __init__(self, cloud: Geometry, camera: Spherical, params: SynthesisParams) -> None:
        self._camera = camera
        pixel = 2.0 * np.pi / camera.full_width
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


def surfels_of(cloud: Geometry, size: float) -> tuple[Geometry, float]:
    """Return a triangle for each voxel of `size` m, and the share of voxels whose neighbours are a surface.

    ValueError where a cloud is too wide for such voxels.
    """
    means = means_of(cloud.points.astype(np.float64), size, cloud.name)
    tree, count = cKDTree(means), min(NUM_NEIGHBORS, len(means))
    vertices, num_dense = np.empty((len(means), 3, 3), np.float32), 0
    for first in range(0, len(means), BATCH):
        own = means[first : first + BATCH]
        apart, rows = tree.query(own, k=count)
        around = means[rows.reshape(len(own), count)]
        around = around - around.mean(axis=1, keepdims=True)
        axes = np.linalg.eigh(np.swapaxes(around, 1, 2) @ around)[1]  # the normal first
        num_dense += int(np.count_nonzero(apart.reshape(len(own), count)[:, count // 2] < NEAR_VOXELS * size))
        for corner, angle in enumerate(CORNERS):
            reach = 2.0 * INRADIUS * size * np.array([np.cos(angle), np.sin(angle)])
            vertices[first : first + BATCH, corner] = own + axes[:, :, 2] * reach[0] + axes[:, :, 1] * reach[1]
    triangles = np.arange(3 * len(means), dtype=np.int32).reshape(-1, 3)
    return Geometry(vertices.reshape(-1, 3), cloud.name, triangles=triangles), num_dense / len(means)
