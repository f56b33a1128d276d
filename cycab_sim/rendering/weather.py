"""What rain, snow, an overcast sky and lamps add to light and reflectance.

    weather.change(view, now, color)                        # reflectance and sky, before `kernels.light`
    weather.add_lamps(view, albedo, color, torch, cast)     # and after it
    weather.mirror(view, color, look)

A lamp of I cd lights a surface at a distance d by I cos(angle) / d^2 lx, where nothing stands between.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import LightParams, SeasonParams
from cycab_sim.rendering.kernels import collect_lit, compare_depths
from cycab_sim.rendering.shadows import ShadowMap
from cycab_sim.rendering.sky import UNIT, SkyLight
from cycab_sim.world.mesh import Mesh
from cycab_sim.world.noise.kernels import sum_octaves
from cycab_sim.world.texture import kernels as k
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Floats, Integers

Cast = Callable[[Array, Floats], Floats]  # range (N,) m of unit rays (N, 3) from a point (3,) m
Look = Callable[
    [Array, Floats, Floats, Floats], Floats
]  # radiance (N, 3) of rays: origin, rays, where they start, cone

# snow: old, dry; of roads and pavements, which are driven and walked on, a part is bare (by eye)
SNOW, SNOW_RELIEF = np.array([0.74, 0.76, 0.80], np.float32), 0.09
WORN = {k.ASPHALT: 0.5, k.MARKING: 0.5, k.PAVING: 0.6}
STEEP, FLAT = 0.5, 0.75  # vertical share of the normal from which snow begins to stay, and all of it stays
PATCH, FILM = 2.5, 1.6  # size of the largest patches of snow and of the largest puddles, m
# wet ground: pores full of water keep half of the light (Lekner and Dorf 1988: 0.4 to 0.7 of the dry reflectance)
DARK, MIRROR_0 = 0.5, 0.02  # share of the light that is kept, and water's reflectance straight down
LEVEL = 0.98  # vertical share of the normal of a surface on which water stands
ROUGH_FILM = 0.25  # mirror of wet ground between puddles, as a share of theirs (by eye)
SHELTER_TEXEL, SHELTER_OFF = 0.2, 0.15  # of the map of what is under something, m; and how far above it looks, m
# street lamps: 20 lx below a lamp of 5.5 m (EN 13201, class C2); white light of 3000 K
STREET_LAMP, WARM = 600.0, np.array([1.25, 1.0, 0.62], np.float32)
CUTOFF = np.cos(np.radians([85.0, 70.0]))  # from straight down: its light ends, and is full
LAMP_REACH = 22.0  # beyond, the light of a street lamp is left out; it fades from 0.7 of it, m
BOUNCE = 0.4  # light that a lit town gives back from everywhere, lx
HEAD, HEAD_SIZE = 2000.0, 0.4  # a lamp's glass, lx of a white surface as bright; surfaces this near it shine, m
WINDOWS, PANE = 0.2, 60.0  # share of the windows that are lit, and what a lit pane is like, lx of a white surface
BEAM = np.cos(np.radians([42.0, 8.0]))  # half angles of a head lamp: its light ends, and is full
TORCH_COLOR = np.array([1.05, 1.0, 0.88], np.float32)
CLEAR, NEARLY = 0.03, 0.002  # a ray from a lamp may end so far before a surface, m, and as a share of its length


@dataclass(frozen=True, eq=False)
class PixelView:
    """What rays (N, 3) f32 from `origin` (3,) m met: triangles (N,), negative: none, ranges (N,) m, cone (N,) rad."""

    origin: Array
    rays: Floats
    ranges: Floats
    triangles: NDArray[np.int32]
    cone: Floats

    def part(self, some: Integers, mesh: Mesh) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """Return points (M, 3), unit normals (M, 3) towards the viewer, and surfaces (M,) of some of the rays."""
        rays, triangles = self.rays[some], self.triangles[some]
        points = self.origin.astype(np.float32) + self.ranges[some, None] * rays
        normals = mesh.normals[triangles]
        normals = np.where(np.sum(normals * rays, axis=1, keepdims=True) > 0.0, -normals, normals)
        return points, normals, mesh.surface_of[triangles]


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp at a point (3,) m that shines along its axis (3,): cosines of its edges, reach m, (3,) cd."""

    at: Array
    axis: Array
    edges: Array
    reach: float
    candela: Floats

    def shine(self, points: Floats, normals: Floats, cast: Cast, light: Floats) -> None:
        """Add its light (N, 3) lx on surfaces at points (N, 3) m with unit normals (N, 3) that it can see."""
        some, rays = np.empty(len(points), np.int64), np.empty_like(points)
        distances, lux = np.empty(len(points), np.float32), np.empty(len(points), np.float32)
        lamp = self.at, self.axis, self.edges
        num = collect_lit(points, normals, lamp, self.reach, some, rays, distances, lux)
        if num == 0:
            return
        is_lit = cast(self.at, rays[:num]) > (1.0 - NEARLY) * distances[:num] - CLEAR
        light[some[:num][is_lit]] += lux[:num][is_lit, None] * self.candela


class Weather:
    """Wet ground, snow, clouds and lamps of a mesh.

    `roof`: what is above something, as a shadow map with the sun overhead.
    """

    def __init__(self, mesh: Mesh, light: LightParams, season: SeasonParams, roof: ShadowMap) -> None:
        self.mesh, self.light, self.season, self._roof = mesh, light, season, roof
        self._wear = np.ones(max(k.FACADE, *WORN) + 1, np.float32)
        self._wear[list(WORN)] = list(WORN.values())
        self._glow = _find_glow(mesh) if light.has_street_lamps else None

    @property
    def has_lamps(self) -> bool:
        """Whether anything but sun and sky gives light."""
        return self.light.has_street_lamps or self.light.torch > 0.0

    def change(self, view: PixelView, now: SkyLight, color: Floats) -> None:
        """Change reflectance and sky (N, 3) in place: clouds, snow, wet ground."""
        if self.light.overcast:
            self._close_sky(view, now, color)
        if not (self.season.snow or self.season.wet):
            return
        upward = np.flatnonzero(view.triangles >= 0)
        upward = upward[np.abs(self.mesh.normals[view.triangles[upward], 2]) > STEEP]
        points, normals, surfaces = view.part(upward, self.mesh)
        is_up = normals[:, 2] > STEEP
        upward, points, up, surfaces = upward[is_up], points[is_up], normals[is_up, 2], surfaces[is_up]
        is_open, kinds = self._openness(points), self.mesh.kinds[surfaces, 0]
        if self.season.wet:
            share = self.season.wet * is_open * _ramp(up, STEEP, FLAT)
            color[upward] *= (1.0 - (1.0 - DARK) * share)[:, None]
        if self.season.snow:
            rough = self._noise(view, upward, points, PATCH, 7901)
            cover = 2.0 * (2.2 * self.season.snow * self._wear[kinds] - 0.6 + 0.35 * rough)
            cover = (np.clip(cover, 0.0, 1.0) * is_open * _ramp(up, STEEP, FLAT))[:, None]
            fresh = SNOW * (1.0 + SNOW_RELIEF * rough)[:, None]
            color[upward] += cover * (fresh - color[upward])

    def add_lamps(self, view: PixelView, albedo: Floats, color: Floats, torch: SE3 | None, cast: Cast) -> None:
        """Add street lamps, lit windows, and the head lamp where it is (x along its beam), to radiance (N, 3)."""
        if not self.has_lamps:
            return
        hit = np.flatnonzero(view.triangles >= 0)
        points, normals, surfaces = view.part(hit, self.mesh)
        light = np.zeros((len(hit), 3), np.float32)
        if torch is not None and self.light.torch:
            lamp = Lamp(torch.translation, torch.rotation[:, 0], BEAM, np.inf, self.light.torch * TORCH_COLOR)
            lamp.shine(points, normals, cast, light)
        if self._glow is not None:
            for place in self._lamps_near(points):
                lamp = Lamp(place, np.array([0.0, 0.0, -1.0]), CUTOFF, LAMP_REACH, STREET_LAMP * WARM)
                lamp.shine(points, normals, cast, light)
            light += BOUNCE * WARM
        light *= albedo[hit]
        if self._glow is not None:
            pane = np.clip(1.0 - 2.5 * albedo[hit].mean(axis=1), 0.1, 1.0)  # the glass shines, its frame does not
            light += (self._glow[surfaces] * pane)[:, None] * WARM
        color[hit] += light / np.float32(UNIT)

    def mirror(self, view: PixelView, color: Floats, look: Look) -> None:
        """Mix what wet, level ground mirrors into radiance (N, 3): Fresnel's share by Schlick, one bounce."""
        if not self.season.wet:
            return
        level = np.flatnonzero((view.triangles >= 0) & (view.rays[:, 2] < 0.0))
        level = level[self.mesh.normals[view.triangles[level], 2] > LEVEL]
        if len(level) == 0:
            return
        points = view.part(level, self.mesh)[0]
        puddle = np.clip(1.5 * self._noise(view, level, points, FILM, 7907) - 0.2, 0.0, 1.0)
        film = self.season.wet * self._openness(points) * (ROUGH_FILM + (1.0 - ROUGH_FILM) * puddle)
        rays = view.rays[level] * np.array([1.0, 1.0, -1.0], np.float32)
        share = (film * (MIRROR_0 + (1.0 - MIRROR_0) * (1.0 - rays[:, 2]) ** 5))[:, None]
        # what is seen in level ground of one height is what a viewer as far below it would see
        below = view.origin * (1.0, 1.0, -1.0) + (0.0, 0.0, 2.0 * float(np.median(points[:, 2])))
        color[level] += share * (look(below, rays, points, view.cone[level]) - color[level])

    def _lamps_near(self, points: Floats) -> Array:
        """Return the places (K, 3) m of the street lamps that may reach some of the points (N, 3) m, by their box."""
        lamps = self.mesh.lamps
        if len(points) == 0:
            return lamps[:0]
        nearest = np.clip(lamps, points.min(axis=0), points.max(axis=0))
        return lamps[np.linalg.norm(lamps - nearest, axis=1) <= LAMP_REACH]

    def _close_sky(self, view: PixelView, now: SkyLight, color: Floats) -> None:
        """Blend the sky into that of a closed layer of clouds, three times as bright overhead as at the horizon."""
        sky = np.flatnonzero(view.triangles == -1)
        height = np.maximum(view.rays[sky, 2:], 0.0)
        gray = 9.0 / 7.0 * (1.0 + 2.0 * height) / 3.0 * now.sky_color.astype(np.float32) / np.float32(now.sky_gain)
        relief = 0.92 + 0.08 * color[sky].mean(axis=1, keepdims=True) / 0.7
        color[sky] += np.float32(self.light.overcast) * (gray * relief - color[sky])

    def _openness(self, points: Floats) -> Floats:
        """Return the share (N,) of the sky straight above points (N, 3) m, blended over four texels."""
        roof = self._roof
        seen = points @ roof.T_sun_world.T.astype(np.float32)
        at = (seen[:, :2] - roof.corner.astype(np.float32)) / np.float32(roof.texel)
        lit = np.empty(len(points), np.float32)
        compare_depths(roof.depths, at, seen[:, 2] - np.float32(SHELTER_OFF), lit)
        return lit

    def _noise(self, view: PixelView, some: Integers, points: Floats, size: float, seed: int) -> Floats:
        """Return noise (M,) at points (M, 3) on level ground, averaged over the footprint of the rays."""
        rays = view.rays[some]
        minor, flat = view.ranges[some] * view.cone[some], np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-6)
        rows = np.empty((8, len(some)), np.float32)
        rows[:2], rows[2], rows[3] = points[:, :2].T, minor, minor / np.maximum(np.abs(rays[:, 2]), 0.03)
        rows[4:6], rows[6], rows[7] = (rays[:, :2] / flat[:, None]).T, 1.0 / size, 0.7
        out = np.empty(len(some), np.float32)
        sum_octaves(rows, np.full(len(some), seed, np.uint32), out)
        return out


def _find_glow(mesh: Mesh) -> Floats:
    """Return what each surface (S,) radiates by itself, lx of a white one as bright: lit windows, glasses of lamps."""
    glow = np.zeros(len(mesh.kinds), np.float32)
    is_window = (mesh.kinds[:, 0] == k.WINDOW) & ~mesh.is_clutter
    glow[is_window & (mesh.kinds[:, 1] % 100 < 100 * WINDOWS)] = PANE
    if len(mesh.lamps):
        middles = -np.einsum("nji,nj->ni", mesh.frames[:, :, :3], mesh.frames[:, :, 3])
        for lamp in mesh.lamps:
            glow[np.linalg.norm(middles - lamp, axis=1) < HEAD_SIZE] = HEAD
    return glow


def _ramp(values: Floats, low: float, high: float) -> Floats:
    """Return 0 below `low`, 1 above `high`, smooth between."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), dtype=np.float32)
