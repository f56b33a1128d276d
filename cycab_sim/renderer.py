"""Images by ray casting: one ray a pixel, more where surfaces meet, texture filtered by the width of the ray.

Steps: cast, paint (texture/kernels.py), light (kernels.py), split edge pixels, tone. Work is cut into strips that
two threads share; the result does not depend on the number of threads.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from cycab_sim import kernels
from cycab_sim.casting.embree import PacketScene, find_library
from cycab_sim.mesh import Mesh
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.texture.painting import paint
from sphere_geometry import SE3, Camera
from sphere_geometry.camera import pixel_grid

Floats = NDArray[np.float32]
STRIP = 16384  # rays a thread works on at once
CURVE_SIZE = 4096
MAX_CAMERAS = 16  # lenses whose rays are kept
NO_HIT = -1
SHADOW_REACH = 400.0  # the sun's rays start this far away, m


@dataclass(frozen=True)
class Hits:
    """What rays (N, 3) met: triangle (N,) i32, -1 for the sky, and range (N,) f32 m."""

    rays: Floats
    triangles: NDArray[np.int32]
    ranges: Floats


class Renderer:
    """Draws a mesh from any camera; holds the ray caster, the shadow map and the rays of the cameras seen so far."""

    def __init__(self, mesh: Mesh, params: RenderParams, light: LightParams) -> None:
        self.mesh = mesh
        self.params = params
        self._scene = EmbreeScene(robust=True)
        self._keep = TriangleMesh(self._scene, mesh.triangles)
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree, not thread-safe
        library = find_library()
        self._packets = PacketScene(library, mesh.triangles) if library is not None else None
        self._pool = ThreadPoolExecutor(max_workers=params.num_threads or os.cpu_count() or 1)
        self._lenses: OrderedDict[Camera, tuple[Floats, Floats]] = OrderedDict()
        self._light = light
        self._curve = (255.0 * np.linspace(0.0, 1.0, CURVE_SIZE) ** (1.0 / light.gamma)).astype(np.float32)
        self._sun = sun_direction(light)
        self._shadow_frame = _shadow_frame(self._sun)
        self._shadow, self._corner = self._cast_shadows()

    def render(
        self, camera: Camera, T_world_camera: SE3, is_grey: bool = False, gain: float = 1.0
    ) -> tuple[Floats, Floats]:
        """Return grey levels 0..255, (H, W, 3) RGB or (H, W) luma f32, and range along the ray (H, W) f32 m.

        +Inf: sky. NaN, and level 0: outside the lens. `gain` multiplies the exposure.
        """
        rays_camera, cone = self._lens(camera)
        height, width = camera.height, camera.width
        rays = (rays_camera.reshape(-1, 3) @ T_world_camera.rotation.T.astype(np.float32)).reshape(rays_camera.shape)
        origin = np.ascontiguousarray(T_world_camera.translation, dtype=np.float64)
        colour = np.empty((height * width, 3), np.float32)
        hits = self._look(origin, rays.reshape(-1, 3), cone.reshape(-1), colour)
        if self.params.supersampling > 1:
            self._refine(origin, rays, cone.reshape(-1), hits, colour)
        image = np.empty((height * width, 1 if is_grey else 3), np.float32)
        kernels.tone(colour, gain * self._light.exposure, self._curve, image)
        image[hits.triangles == kernels.OUTSIDE] = 0.0
        ranges = hits.ranges.reshape(height, width)
        return image.reshape((height, width) if is_grey else (height, width, 3)), ranges

    def measure(self, origin: NDArray[np.float64], rays: Floats) -> Floats:
        """Return the range (N,) f32 m along unit rays (N, 3) f32 from a point (3,) f64 of the world; +Inf: sky."""
        triangles, ranges = np.empty(len(rays), np.int32), np.empty(len(rays), np.float32)
        self._cast(origin, rays, triangles, ranges)
        return ranges

    def _look(self, origin: NDArray[np.float64], rays: Floats, cone: Floats, colour: Floats) -> Hits:
        """Cast rays (N, 3), write their radiance to colour (N, 3), return what they met."""
        triangles = np.empty(len(rays), np.int32)
        ranges = np.empty(len(rays), np.float32)

        def work(first: int) -> None:
            part = slice(first, first + STRIP)
            self._cast(origin, rays[part], triangles[part], ranges[part])
            self._shade(origin, Hits(rays[part], triangles[part], ranges[part]), cone[part], colour[part])

        list(self._pool.map(work, range(0, len(rays), STRIP)))
        return Hits(rays, triangles, ranges)

    def _cast(self, origin: NDArray[np.float64], rays: Floats, triangles: NDArray[np.int32], ranges: Floats) -> None:
        if self._packets is not None:
            self._packets.cast(origin, rays, triangles, ranges)
        else:
            starts = np.empty_like(rays)
            starts[:] = origin
            found = self._scene.run(starts, rays, query="INTERSECT", output=1)
            triangles[:] = found["primID"]
            ranges[:] = np.where(triangles == NO_HIT, np.inf, found["tfar"])
        outside = np.isnan(rays[:, 0])
        if outside.any():
            triangles[outside], ranges[outside] = kernels.OUTSIDE, np.nan

    def _shade(self, origin: NDArray[np.float64], hits: Hits, cone: Floats, colour: Floats) -> None:
        m = self.mesh
        paint(m, origin, hits.rays, hits.ranges, hits.triangles, cone, colour)
        kernels.light(
            origin, hits.rays, hits.ranges, hits.triangles, cone, m.normals,
            self._sun, self._shadow, self.params.shadow_texel, self._corner, self._shadow_frame, colour,
        )  # fmt: skip

    def _refine(self, origin: NDArray[np.float64], rays: Floats, cone: Floats, hits: Hits, colour: Floats) -> None:
        """Look again with n x n rays at pixels where surfaces meet."""
        n = self.params.supersampling
        shape = rays.shape[:2]
        is_edge = np.empty(shape, np.uint8)
        triangles, ranges = hits.triangles.reshape(shape), hits.ranges.reshape(shape)
        m = self.mesh
        kernels.find_edges(triangles, m.surface_of, m.normals, ranges, colour.reshape(*shape, 3), is_edge)
        edges = np.flatnonzero(is_edge)
        finer = np.empty((len(edges) * n * n, 3), np.float32)
        samples = np.empty_like(finer)
        kernels.split_rays(rays, edges, n, finer)
        self._look(origin, finer, np.repeat(cone[edges] / np.float32(n), n * n), samples)
        kernels.merge_samples(samples, edges, n, colour)

    def _lens(self, camera: Camera) -> tuple[Floats, Floats]:
        """Return the unit rays (H, W, 3) of a camera and the angle (H, W) between neighbouring rays."""
        if camera not in self._lenses:
            rays = camera.unproject(pixel_grid(camera))
            self._lenses[camera] = (rays.astype(np.float32), _spacing(rays))
            if len(self._lenses) > MAX_CAMERAS:
                self._lenses.popitem(last=False)
        self._lenses.move_to_end(camera)
        return self._lenses[camera]

    def _cast_shadows(self) -> tuple[Floats, NDArray[np.float64]]:
        """Return how far along the sun's rays the first surface lies, (K, K) f32 m, and the map's corner (2,) m."""
        if not self._light.has_shadows:
            return np.full((2, 2), np.inf, np.float32), np.zeros(2)
        R, texel = self._shadow_frame, self.params.shadow_texel
        size = int(self.params.shadow_extent / texel)
        middle = R[:2] @ self._light_centre()
        corner = middle - 0.5 * size * texel
        depth = np.empty((size, size), np.float32)
        columns = corner[0] + texel * np.arange(size)
        direction = R[2:].astype(np.float32)
        base = float(R[2] @ self._light_centre()) - SHADOW_REACH

        def work(row: int) -> None:
            local = np.stack([columns, np.full(size, corner[1] + texel * row), np.full(size, base)], axis=1)
            starts = (local @ R).astype(np.float32)
            far = self._scene.run(starts, np.repeat(direction, size, axis=0), query="DISTANCE")
            depth[row] = base + far

        list(self._pool.map(work, range(size)))
        return depth, corner

    def _light_centre(self) -> NDArray[np.float64]:
        """Return the middle of the shadow map on the ground: the middle of the detailed part of the mesh."""
        return np.median(self.mesh.triangles.reshape(-1, 3), axis=0).astype(np.float64) * (1.0, 1.0, 0.0)


def sun_direction(light: LightParams) -> NDArray[np.float64]:
    """Return the unit vector (3,) towards the sun."""
    azimuth, elevation = np.radians([light.sun_azimuth_deg, light.sun_elevation_deg])
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def _spacing(rays: NDArray[np.float64]) -> Floats:
    """Return the larger of the angles (H, W) rad from each ray (H, W, 3) to its right and lower neighbour."""
    right = np.linalg.norm(np.diff(rays, axis=1), axis=-1)
    below = np.linalg.norm(np.diff(rays, axis=0), axis=-1)
    right, below = np.concatenate([right, right[:, -1:]], axis=1), np.concatenate([below, below[-1:]], axis=0)
    return np.fmax(right, below).astype(np.float32)


def _shadow_frame(sun: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows x, y across the sun's rays and z along them, (3, 3)."""
    x = np.cross([0.0, 0.0, 1.0], sun)
    norm = np.linalg.norm(x)
    x = x / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.stack([x, np.cross(-sun, x), -sun])
