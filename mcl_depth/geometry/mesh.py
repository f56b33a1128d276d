"""Surfaces as a map: triangles, or points on them.

Range panoramas of triangles by ray casting (Embree).
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from mcl_depth.constants import MAX_ELEMENTS
from mcl_depth.geometry.cloud import Geometry, cloud_from_points
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays

Image = NDArray[np.float32]


class RayScene:
    """A mesh, and the rays of one panorama."""

    def __init__(self, mesh: Geometry, camera: Spherical, params: SynthesisParams) -> None:
        self._params = params
        self._shape = (camera.height, camera.width)
        self._rays = np.ascontiguousarray(pixel_rays(camera).reshape(-1, 3), np.float32)
        self._scene = EmbreeScene(robust=True)
        self._keep = TriangleMesh(self._scene, mesh.points[mesh.triangles])
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree, not thread-safe
        self._pool = ThreadPoolExecutor(max_workers=os.cpu_count() or 1)

    def ranges(self, positions_map: NDArray[np.float64]) -> Image:
        """Return ranges (M, H, W) in m around places (M, 3); NaN where a ray meets nothing."""
        return np.stack(list(self._pool.map(self._cast, positions_map)))

    def _cast(self, position: NDArray[np.float64]) -> Image:
        starts = np.tile(position.astype(np.float32), (len(self._rays), 1))
        found = self._scene.run(starts, self._rays, query="INTERSECT", output=1)
        is_known = (found["primID"] >= 0) & (found["tfar"] <= self._params.max_range_m)
        return np.where(is_known, found["tfar"], np.float32(np.nan)).reshape(self._shape)


def mesh_from_faces(vertices: NDArray[np.floating], triangles: NDArray[np.integer], name: str) -> Geometry:
    """Check vertices and faces; faces with a vertex that is not finite, or without an area, are left out."""
    vertices, triangles = np.asarray(vertices, np.float64), np.asarray(triangles, np.int64)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        found = f"{triangles.min()} to {triangles.max()}"
        raise ValueError(f"{name}: faces: expected indices 0 to {len(vertices) - 1}, found {found}")
    corners = vertices[triangles]
    area = _areas_of(corners)
    kept = np.isfinite(area) & (area > 0)
    if not kept.any():
        raise ValueError(f"{name}: faces: expected at least one with an area, found {len(kept)} without")
    used, owner = np.unique(triangles[kept], return_inverse=True)
    checked = cloud_from_points(vertices[used], name)
    lost = int((~kept).sum())
    notes = (f"{name}: {lost} of {len(kept)} faces have no finite area and are left out",) if lost else ()
    return replace(checked, warnings=notes + checked.warnings, triangles=owner.reshape(-1, 3).astype(np.int32))


def sample_surface(mesh: Geometry, spacing_m: float = 0.05) -> Geometry:
    """Return points spread evenly over the faces, about one to every square of side `spacing_m`."""
    corners = mesh.points[mesh.triangles].astype(np.float64)
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = _areas_of(corners)
    count = int(np.ceil(area.sum() / spacing_m**2))
    if count > MAX_ELEMENTS:
        raise ValueError(f"{mesh.name}: expected at most {MAX_ELEMENTS} samples, found {count}: choose a wider spacing")
    # stratified along the running sum of the areas, a low-discrepancy pair inside each triangle
    rng = np.random.default_rng(0)
    places = (np.arange(count) + rng.random(count)) / count * area.sum()
    face = np.minimum(np.searchsorted(np.cumsum(area), places), len(area) - 1)
    root, b = np.sqrt(rng.random(count)), rng.random(count)
    points = corners[face, 0] + (root * (1 - b))[:, None] * along[face] + (root * b)[:, None] * across[face]
    return Geometry(points.astype(np.float32), mesh.name, mesh.warnings)


def _areas_of(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the areas (T,) of triangles (T, 3, 3)."""
    sides = corners[:, 1:] - corners[:, :1]
    areas: NDArray[np.float64] = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return areas
