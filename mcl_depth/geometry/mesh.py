"""Surfaces as a map: triangles, or points on them.

Range panoramas of triangles by ray casting (Embree).
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from mcl_depth.constants import MAX_ELEMENTS
from mcl_depth.geometry.cloud import Cloud, cloud_from_points
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays

Image = NDArray[np.float32]


class RayScene:
    """A mesh, and the rays of one panorama."""

    def __init__(self, mesh: TriangleMesh, camera: Spherical, params: SynthesisParams) -> None:
        self._params = params
        self._shape = (camera.height, camera.width)
        self._rays = np.ascontiguousarray(pixel_rays(camera).reshape(-1, 3), np.float32)
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
        is_known = (found["primID"] >= 0) & (found["tfar"] <= self._params.max_range_m)
        out[:] = np.where(is_known, found["tfar"], np.float32(np.nan)).reshape(out.shape)


@dataclass(frozen=True)
class TriangleMesh:
    """Vertices (V, 3) float32 in the map frame in metres, and triangles (T, 3) int32 of their indices."""

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    name: str = "mesh"
    warnings: tuple[str, ...] = ()
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # E, N, H in m of the survey at the origin of the map

    @property
    def box(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Lowest and highest coordinates, (3,) each."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)


def mesh_from_faces(vertices: NDArray[np.floating], triangles: NDArray[np.integer], name: str) -> TriangleMesh:
    """Check vertices and faces; faces with a vertex that is not finite, or without an area, are left out."""
    vertices, triangles = np.asarray(vertices, np.float64), np.asarray(triangles, np.int64)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        found = f"{triangles.min()} to {triangles.max()}"
        raise ValueError(f"{name}: faces: expected indices 0 to {len(vertices) - 1}, found {found}")
    corners = vertices[triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    kept = np.isfinite(area) & (area > 0)
    if not kept.any():
        raise ValueError(f"{name}: faces: expected at least one with an area, found {len(kept)} without")
    used, owner = np.unique(triangles[kept], return_inverse=True)
    checked = cloud_from_points(vertices[used], name)
    lost = int((~kept).sum())
    notes = (f"{name}: {lost} of {len(kept)} faces have no finite area and are left out",) if lost else ()
    return TriangleMesh(checked.points, owner.reshape(-1, 3).astype(np.int32), name, notes + checked.warnings)


def sample_surface(mesh: TriangleMesh, spacing_m: float = 0.05) -> Cloud:
    """Return points spread evenly over the faces, about one to every square of side `spacing_m`."""
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.linalg.norm(np.cross(along, across), axis=1)
    count = int(np.ceil(area.sum() / spacing_m**2))
    if count > MAX_ELEMENTS:
        raise ValueError(f"{mesh.name}: expected at most {MAX_ELEMENTS} samples, found {count}: choose a wider spacing")
    # stratified along the running sum of the areas, a low-discrepancy pair inside each triangle
    rng = np.random.default_rng(0)
    places = (np.arange(count) + rng.random(count)) / count * area.sum()
    face = np.minimum(np.searchsorted(np.cumsum(area), places), len(area) - 1)
    root, b = np.sqrt(rng.random(count)), rng.random(count)
    points = corners[face, 0] + (root * (1 - b))[:, None] * along[face] + (root * b)[:, None] * across[face]
    return Cloud(points.astype(np.float32), mesh.name, mesh.warnings)
