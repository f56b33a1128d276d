"""The worlds: a town; a city; a corridor where every bay looks like the next; a ramp of 8 %.

`build_world` gives the mesh, the ground that the car follows and the taught path; `geometry_cloud` the bare geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from cycab_sim.params import SeasonParams
from cycab_sim.world import finishes, furniture
from cycab_sim.world.building import add_house
from cycab_sim.world.city import BOUNDS, build_city, tour
from cycab_sim.world.mesh import BOX_FACES, Mesh, MeshBuilder, Rectangle, flat
from cycab_sim.world.paths import Path, Piece
from cycab_sim.world.town import build_town, taught_path
from cycab_sim.world.traffic.loops import Loop, city_loops, town_loops
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array

WORLDS = ("town", "city", "corridor", "ramp")
CORRIDOR, BAY, HALF_WIDTH, STOREY = 160.0, 8.0, 1.7, 3.2  # m
NICHE, NICHE_DEPTH = 1.6, 0.6  # one a bay on either side, m
BREAKS = np.array([-200.0, 20.0, 60.0, 80.0, 120.0, 400.0])  # x of the ramp world's breaks, m
HEIGHTS = np.array([0.0, 0.0, 3.2, 3.2, 0.0, 0.0])  # 8 % up, flat, 8 % down, m
MAX_SIDE = 12.0  # of a triangle from which points are drawn, m
CLOUD_MARGIN = 12.0  # of the town's surroundings that belong to the cloud, m


@dataclass(frozen=True)
class GroundProfile:
    """Height of the ground as a broken line along x; flat without breaks."""

    breaks: tuple[float, ...] = (0.0,)
    heights: tuple[float, ...] = (0.0,)

    def height(self, x: Array | float) -> Array:
        """Return the height (...) m at x (...) m."""
        return np.asarray(np.interp(x, self.breaks, self.heights))

    def follow(self, T_world_planar: SE3, wheelbase: float, track: float) -> SE3:
        """Return the pose of a car whose wheels stand on the ground; its planar pose is that of the rear axle."""
        if len(self.breaks) == 1:
            return T_world_planar
        wheels = [[0, 0, 0], [wheelbase, 0, 0], [0, track / 2, 0], [0, -track / 2, 0]]
        rear, front, left, right = self.height(T_world_planar.apply(np.array(wheels, dtype=np.float64))[:, 0])
        pitch, roll = -np.arctan2(front - rear, wheelbase), np.arctan2(left - right, track)
        lift = SE3.from_parts(np.eye(3), [0.0, 0.0, float(rear)])
        return lift @ T_world_planar @ SE3.from_angles(float(roll), float(pitch), 0.0, np.zeros(3))


RAMP = GroundProfile(tuple(BREAKS), tuple(HEIGHTS))


@dataclass(frozen=True)
class World:
    """A mesh, the ground, the path, the box x0, y0, x1, y1 m of its detailed part, and where traffic goes."""

    mesh: Mesh
    ground: GroundProfile
    path: Path
    bounds: Rectangle
    loops: tuple[Loop, ...] = ()


def build_world(world: str, seed: int, path: str = "two_turns", season: SeasonParams | None = None) -> World:
    """Return a world of a seed; `path` names the town's path, the others have one only."""
    season = season or SeasonParams()
    if world == "town":
        mesh, plan = build_town(seed, season)
        return World(mesh, GroundProfile(), taught_path(plan, path), plan.bounds, town_loops(plan))
    if world == "city":
        return World(build_city(seed, season), GroundProfile(), tour(), BOUNDS, city_loops())
    if world == "corridor":
        path_along = Path((4.0, 0.0, 0.0), (Piece(CORRIDOR - 8.0),))
        return World(_build_corridor(seed), GroundProfile(), path_along, (0.0, -4.0, CORRIDOR, 4.0))
    if world == "ramp":
        return World(
            _build_ramp(seed, season), RAMP, Path((0.0, -0.5, 0.0), (Piece(130.0),)), (-20.0, -20.0, 160.0, 20.0)
        )
    raise ValueError(f"world: expected one of {', '.join(WORLDS)}, found {world!r}")


def geometry_cloud(seed: int, spacing: float = 0.1, world: str = "town") -> Array:
    """Return points (N, 3) m on the surfaces of a static world, about one each `spacing` m, no colour.

    What comes and goes is missing: parked cars, bins and crates. Traffic never belongs to it.
    """
    if not (np.isfinite(spacing) and spacing > 0.0):
        raise ValueError(f"spacing: expected a distance above 0 m, found {spacing}")
    built = build_world(world, seed)
    faces = built.mesh.triangles.astype(np.float64)
    keep = ~built.mesh.is_clutter[built.mesh.surface_of]
    points = _sample(faces[keep], spacing, np.random.default_rng([seed, 51]), built.bounds)
    cells = np.floor(points / spacing).astype(np.int64)
    low, size = cells.min(axis=0), np.ptp(cells, axis=0) + 1
    codes = np.ravel_multi_index(tuple((cells - low).T), tuple(size))
    return np.ascontiguousarray(points[np.sort(np.unique(codes, return_index=True)[1])])


def _sample(faces: Array, spacing: float, rng: np.random.Generator, bounds: Rectangle) -> Array:
    """Return random points on triangles (T, 3, 3) inside the bounds, two for each cell of `spacing`^2."""
    low, high = np.array(bounds[:2]) - CLOUD_MARGIN, np.array(bounds[2:]) + CLOUD_MARGIN
    faces = _split(faces, low, high)
    area = 0.5 * np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1)
    count = np.floor(2.0 * area / spacing**2 + rng.random(len(faces))).astype(np.int64)
    parts = []
    for part in np.array_split(np.arange(len(faces)), 16):
        a, b = np.sqrt(rng.random(count[part].sum())), rng.random(count[part].sum())
        p = np.repeat(faces[part], count[part], axis=0)
        points = (1 - a)[:, None] * p[:, 0] + (a * (1 - b))[:, None] * p[:, 1] + (a * b)[:, None] * p[:, 2]
        parts.append(points[np.all((points[:, :2] > low) & (points[:, :2] < high), axis=1)])
    return np.concatenate(parts)


def _split(faces: Array, low: Array, high: Array) -> Array:
    """Return triangles (T, 3, 3) of at most MAX_SIDE m that touch a rectangle; those far outside are left out."""
    done = []
    while len(faces):
        faces = faces[np.all((faces[..., :2].max(axis=1) > low) & (faces[..., :2].min(axis=1) < high), axis=1)]
        is_large = np.ptp(faces, axis=1).max(axis=1) > MAX_SIDE
        done.append(faces[~is_large])
        a, b, c = np.moveaxis(faces[is_large], 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        faces = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return np.concatenate(done)


@lru_cache(maxsize=1)
def _build_corridor(seed: int) -> Mesh:
    """Return a corridor along x: in every bay a niche on either side; only the ends and the texture tell bays apart."""
    rng = np.random.default_rng([seed, 61])
    mesh = MeshBuilder(rng)
    end, h, top = CORRIDOR, HALF_WIDTH, STOREY
    wall, door = finishes.wall(rng), finishes.slats(finishes.pick(rng, finishes.WOODWORK))
    mesh.panels(BOX_FACES[5] * [end, 2 * h + 2, 0] - [0, h + 1, 0], finishes.ROOF_FLAT)
    mesh.panels(flat(0, -h, end, h, 0), finishes.PAVING)
    mesh.panels(flat(0, h, end, -h, top), finishes.TRIM)
    for x in (-0.3, end):
        mesh.box([x, -h, 0], [0.3, 2 * h, top], wall)
    mesh.box([end - 0.05, -0.6, 0], [0.05, 1.2, 2.2], door)  # the one mark of its kind, at the far end
    for bay in np.arange(0.0, end, BAY):
        for side in (-1.0, 1.0):
            low = h if side > 0 else -h - NICHE_DEPTH
            mesh.box([bay, low, 0], [BAY - NICHE, NICHE_DEPTH, top], wall)
            back = h + NICHE_DEPTH if side > 0 else -h - NICHE_DEPTH - 0.1
            mesh.box([bay + BAY - NICHE, back, 0], [NICHE, 0.1, top], door)
    return mesh.build()


@lru_cache(maxsize=1)
def _build_ramp(seed: int, season: SeasonParams) -> Mesh:
    """Return a street along x, houses and trees on either side, everything lifted to the ground's height."""
    rng = np.random.default_rng([seed, 62])
    mesh = MeshBuilder(rng, season, height=RAMP.height)
    edges = np.unique(np.concatenate([BREAKS[1:-1], np.arange(-40.0, 181.0, 10.0)]))
    for x0, x1 in pairwise(edges):
        mesh.panels(flat(x0, -60, x1, 60, -0.02), finishes.SOIL)
        mesh.panels(flat(x0, -3.75, x1, 3.75, 0), finishes.ASPHALT)
        for y in (-6.0, 3.75):
            mesh.panels(flat(x0, y, x1, y + 2.25, 0.1), finishes.PAVING)
    for side in (0.0, np.pi):
        x = -36.0
        while x < 150.0:
            width = rng.uniform(6.5, 10.0)
            front = mesh.at(x, 6.0) if side == 0.0 else mesh.at(x + width, -6.0, np.pi)
            add_house(front, width, 8.0, int(rng.integers(2, 5)))
            if rng.random() < 0.5:
                y = 4.6 if side == 0.0 else -4.6
                furniture.add_tree(mesh.at(x, y, rng.uniform(0, 6.28), 0.1))
            x += width + (rng.uniform(2.0, 5.0) if rng.random() < 0.3 else 0.0)
    for x in (-42.0, 156.0):
        mesh.box([x, -9.0, 0.0], [6.0, 18.0, 9.0], finishes.wall(rng))
    return mesh.build()
