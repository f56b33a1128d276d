"""Images by ray casting: one ray a pixel, more where surfaces meet, texture filtered by the width of the ray.

Steps: cast, paint (texture/kernels.py), light (kernels.py), split edge pixels, tone. Work is cut into strips that
two threads share; the result does not depend on the number of threads.

Colours of what rays have met: where on its surface, how rough it is there, and what its material makes of that.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cycab_sim.params import LightParams, RenderParams, SeasonParams
from cycab_sim.rendering import kernels
from cycab_sim.rendering.embree import MovingScene, PacketScene
from cycab_sim.rendering.shadows import ShadowMap
from cycab_sim.rendering.sky import light_at
from cycab_sim.rendering.weather import SHELTER_TEXEL, PixelView, Weather
from cycab_sim.world.mesh import Mesh, Rectangle
from cycab_sim.world.noise.kernels import sum_octaves
from cycab_sim.world.texture.kernels import dress, locate_surfaces
from cycab_sim.world.traffic.traffic import Traffic
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array, Floats, Integers
from sphere_nav.geometry.cameras.camera import pixel_rays


def _paint_rays(mesh: Mesh, view: PixelView, color: Floats) -> None:
    """Write the linear colour (N, 3) of what is in view; arrays: see `locate_surfaces` and `dress`."""
    num = len(view.rays)
    points, depths = np.empty((8, num), np.float32), np.empty(num, np.float32)
    seeds, rough = np.empty(num, np.uint32), np.empty(num, np.float32)
    locate_surfaces(
        view.origin, view.rays, view.ranges, view.triangles, view.cone,
        mesh.surface_of, mesh.frames, mesh.kinds, points, depths, seeds,
    )  # fmt: skip
    sum_octaves(points, seeds, rough)
    dress(
        view.rays, view.triangles, mesh.surface_of, mesh.kinds, mesh.params, mesh.colors, points, depths, rough, color
    )


STRIP = 16384  # rays a thread works on at once
CURVE_SIZE = 4096
MAX_CAMERAS = 16  # lenses whose rays are kept
NO_HIT = -1
MAX_TEXELS = 4000  # of a side of the shadow map
LEAVE = 0.01  # a mirrored ray begins so far from the ground, m
ABOVE = 0.1  # a ray to the sun begins so far from what it left, m
TALL = 3.5  # nothing that moves is higher, m


class Renderer:
    """Draws a mesh from any camera; holds the ray caster and the shadow map.

    `traffic` moves, see `move`; shadows of what stands reach as far as the bounds (x0, y0, x1, y1) m;
    `torch` is where the head lamp is, x along its beam; the sun of `light` stands still, its brightness may change.
    """

    def __init__(
        self,
        mesh: Mesh,
        params: RenderParams,
        light: LightParams,
        traffic: Traffic | None = None,
        bounds: Rectangle = (-80.0, -80.0, 80.0, 80.0),
        season: SeasonParams | None = None,
    ) -> None:
        self.params = params
        self.torch: SE3 | None = None
        self._scene = PacketScene(mesh.triangles)
        self._moving = MovingScene(mesh, traffic) if traffic is not None else None
        self.mesh = self._moving.mesh if self._moving is not None else mesh
        self._pool = ThreadPoolExecutor(max_workers=os.cpu_count() or 1)
        self._exposure = light.exposure
        self._curve = (255.0 * np.linspace(0.0, 1.0, CURVE_SIZE) ** (1.0 / light.gamma)).astype(np.float32)
        x0, y0, x1, y1 = bounds
        extent, middle = float(np.hypot(x1 - x0, y1 - y0)), np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
        texel = max(params.shadow_texel, extent / MAX_TEXELS)
        shadow = extent * (params.shadow_texel > 0.0), texel
        self.light = light_at(light, 0.0, 0)
        self._shadows = ShadowMap(self._scene, shadow, self.light.sun, middle)
        shelter = extent, max(SHELTER_TEXEL, texel)
        roof = ShadowMap(self._scene, shelter, np.array([0.0, 0.0, 1.0]), middle)
        self._weather = Weather(self.mesh, light, season or SeasonParams(), roof)

    def move(self, T_world_part: Array) -> None:
        """Put the traffic where it is now, T_world_part (P, 4, 4) of `Traffic.poses`."""
        if self._moving is None:
            raise ValueError("traffic: expected a renderer with traffic, found one without")
        self._moving.move(T_world_part)

    def render(
        self, camera: Camera, T_world_camera: SE3, is_gray: bool = False, gain: ArrayLike = 1.0
    ) -> tuple[Floats, Floats]:
        """Return grey levels 0..255, (H, W, 3) RGB or (H, W) luma f32, and range along the ray (H, W) f32 m.

        +Inf: sky. NaN, and level 0: outside the lens. `gain`, one or (3,) for the colours, multiplies the exposure.
        """
        rays_camera, cone = lens_rays(camera)
        height, width = camera.height, camera.width
        rays = np.empty_like(rays_camera)
        R = np.ascontiguousarray(T_world_camera.rotation, dtype=np.float32)
        kernels.turn_rays(rays_camera.reshape(-1, 3), R, rays.reshape(-1, 3))
        origin = np.ascontiguousarray(T_world_camera.translation, dtype=np.float64)
        color = np.empty((height * width, 3), np.float32)
        hits = self._look(origin, rays.reshape(-1, 3), cone.reshape(-1), color)
        if self.params.supersampling > 1:
            self._refine(rays, hits, color)
        image = np.empty((height * width, 1 if is_gray else 3), np.float32)
        gains = np.broadcast_to(np.asarray(gain, dtype=np.float64) * self._exposure, 3).copy()
        kernels.tone(color, gains, self._curve, image)
        image[hits.triangles == kernels.OUTSIDE] = 0.0
        ranges = hits.ranges.reshape(height, width)
        return image.reshape((height, width) if is_gray else (height, width, 3)), ranges

    def measure(self, origin: Array, rays: Floats) -> Floats:
        """Return the range (N,) f32 m along unit rays (N, 3) f32 from a point (3,) f64 of the world; +Inf: sky."""
        return self._cast(origin, rays)[1]

    def _look(self, origin: Array, rays: Floats, cone: Floats, color: Floats) -> PixelView:
        """Cast rays (N, 3), write their radiance to colour (N, 3), return what they met."""
        triangles = np.empty(len(rays), np.int32)
        ranges = np.empty(len(rays), np.float32)

        def work(first: int) -> None:
            part = slice(first, first + STRIP)
            triangles[part], ranges[part] = self._cast(origin, rays[part])
            view = PixelView(origin, rays[part], ranges[part], triangles[part], cone[part])
            self._shade(view, color[part])

        list(self._pool.map(work, range(0, len(rays), STRIP)))
        return PixelView(origin, rays, ranges, triangles, cone)

    def _cast(self, origin: Array, rays: Floats) -> tuple[NDArray[np.int32], Floats]:
        triangles, ranges = self._scene.cast(origin, rays)
        if self._moving is not None:
            self._moving.scene.cast_nearer(origin, rays, triangles, ranges)
        outside = np.isnan(rays[:, 0])
        triangles[outside], ranges[outside] = kernels.OUTSIDE, np.nan
        return triangles, ranges

    def _shade(self, view: PixelView, color: Floats, is_mirror: bool = False) -> None:
        m, s, now = self.mesh, self._shadows, self.light
        lamps = now.sun, now.sun_color, now.sky_color, now.sky_gain
        _paint_rays(m, view, color)
        self._weather.change(view, now, color)
        albedo = color.copy() if self._weather.has_lamps else color
        kernels.light(
            view.origin, view.rays, view.ranges, view.triangles, view.cone, m.normals,
            lamps, self._open_to_sun(view), s.depths, s.texel, s.corner, s.T_sun_world, color,
        )  # fmt: skip
        self._weather.add_lamps(view, albedo, color, self.torch, self.measure)
        if not is_mirror:
            self._weather.mirror(view, color, self._look_back)

    def _open_to_sun(self, view: PixelView) -> Floats:
        """Return 0 where something that moves hides the sun from what rays (N,) met, 1 elsewhere."""
        is_open = np.ones(len(view.rays), np.float32)
        if self._moving is not None and self.params.shadow_texel > 0.0:
            met = np.flatnonzero(view.triangles >= 0)
            points, normals, _ = view.part(met, self.mesh)
            sun = self.light.sun.astype(np.float32)
            may_be = (points[:, 2] < TALL) & (normals @ sun > 0.0)
            starts = (points + np.float32(ABOVE) * normals)[may_be]
            is_open[met[may_be]] = self._moving.scene.cast(starts, np.tile(sun, (len(starts), 1)))[0] == NO_HIT
        return is_open

    def _look_back(self, below: Array, rays: Floats, starts: Floats, cone: Floats) -> Floats:
        """Return the radiance (N, 3) of unit rays (N, 3) that leave level ground at `starts` (N, 3) m.

        `below` (3,) is the viewer mirrored by the ground, from whom the distance to what they meet is the whole way.
        """
        triangles, found = self._scene.cast(starts + np.float32(LEAVE) * rays, rays)
        is_hit = triangles != NO_HIT
        way = starts + np.where(is_hit, found, np.float32(1.0))[:, None] * rays - below.astype(np.float32)
        ranges = np.linalg.norm(way, axis=1)
        seen = np.where(is_hit[:, None], way / ranges[:, None], rays).astype(np.float32)
        ranges = np.where(is_hit, ranges, np.inf).astype(np.float32)
        if self._moving is not None:  # all of it is above the ground
            self._moving.scene.cast_nearer(below, seen, triangles, ranges)
        color = np.empty_like(rays)
        mirrored = PixelView(below, seen, ranges, triangles, cone)
        self._shade(mirrored, color, is_mirror=True)
        return color

    def _refine(self, rays: Floats, hits: PixelView, color: Floats) -> None:
        """Look again with n x n rays at pixels where surfaces meet."""
        n = self.params.supersampling
        shape = rays.shape[:2]
        is_edge = np.empty(shape, np.uint8)
        triangles, ranges = hits.triangles.reshape(shape), hits.ranges.reshape(shape)
        m = self.mesh
        kernels.find_edges(triangles, m.surface_of, ranges, color.reshape(*shape, 3), is_edge)
        edges = np.flatnonzero(is_edge)
        finer = _split(rays, edges, n)
        samples = np.empty_like(finer)
        self._look(hits.origin, finer, np.repeat(hits.cone[edges] / np.float32(n), n * n), samples)
        sums = samples.reshape(-1, n * n, 3).sum(axis=1, dtype=np.float64)
        color[edges] = sums / (n * n)


@lru_cache(MAX_CAMERAS)
def lens_rays(camera: Camera) -> tuple[Floats, Floats]:
    """Return the unit rays (H, W, 3) of a camera and the angle (H, W) between neighbouring rays."""
    rays = pixel_rays(camera)
    return rays.astype(np.float32), _spacing(rays)


def _split(rays: Floats, edges: Integers, n: int) -> Floats:
    """Return n x n rays (E n n, 3) around some rays (E,) of an image (H, W, 3), by how their neighbours differ."""
    middle = rays.reshape(-1, 3)[edges]
    down, across = (np.nan_to_num(np.gradient(rays, axis=axis).reshape(-1, 3)[edges]) for axis in (0, 1))
    shares = ((np.arange(n, dtype=np.float32) + 0.5) / n - 0.5)[:, None, None]
    finer = middle + shares * across + (shares * down)[:, None]  # (n, n, E, 3)
    finer /= np.linalg.norm(finer, axis=-1, keepdims=True)
    return np.ascontiguousarray(finer.transpose(2, 0, 1, 3)).reshape(-1, 3)


def _spacing(rays: Array) -> Floats:
    """Return the larger of the angles (H, W) rad from each ray (H, W, 3) to its right and lower neighbour."""
    right = np.linalg.norm(np.diff(rays, axis=1), axis=-1)
    below = np.linalg.norm(np.diff(rays, axis=0), axis=-1)
    right, below = np.concatenate([right, right[:, -1:]], axis=1), np.concatenate([below, below[-1:]], axis=0)
    return np.fmax(right, below).astype(np.float32)
