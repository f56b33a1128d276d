"""Triangles with a surface each: what the ray caster and the texture need to know of the world."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cycab_sim.params import SeasonParams
from sphere_nav.geometry.arrays import Array, Flags, Floats, Integers

NUM_PARAMS = 6
Rectangle = tuple[float, float, float, float]  # x0, y0, x1, y1
BOX_FACES = np.array(  # corners of a unit box, face by face, counter-clockwise from outside, lower left first
    [
        [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
        [[1, 1, 0], [0, 1, 0], [0, 1, 1], [1, 1, 1]],
        [[0, 1, 0], [0, 0, 0], [0, 0, 1], [0, 1, 1]],
        [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]],
        [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
        [[0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0]],
    ],
    dtype=np.float64,
)


REVEAL = np.concatenate([BOX_FACES[[5, 4], ::-1], BOX_FACES[[2, 3]][:, [1, 0, 3, 2]]])  # floor, top, sides from inside


@dataclass(frozen=True)
class Finish:
    """Material with its two linear colours and up to six numbers (params[0]: contrast); see texture/kernels.py."""

    kind: int
    color: tuple[float, float, float]
    second: tuple[float, float, float] = (0.3, 0.3, 0.3)
    params: tuple[float, ...] = (0.12,)


@dataclass(frozen=True)
class Mesh:
    """Triangles (T, 3, 3) f32 m, their normals (T, 3) f32 and surfaces (T,) i32, and one row per surface.

    frames (S, 3, 4) f32 world to surface (u along, v up, w out), kinds (S, 2) i32 material and seed,
    params (S, 6) f32, colours (S, 2, 3) f32, is_clutter (S,) bool: what comes and goes, as parked cars;
    lamps (L, 3) m: where street lamps shine
    """

    triangles: Floats
    normals: Floats
    surface_of: NDArray[np.int32]
    frames: Floats
    kinds: NDArray[np.int32]
    params: Floats
    colors: Floats
    is_clutter: Flags
    lamps: Array


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Return one mesh of several, triangles and surfaces one after the other."""
    counts = np.cumsum([0] + [len(mesh.frames) for mesh in meshes])
    columns = {item.name: [getattr(mesh, item.name) for mesh in meshes] for item in fields(Mesh)}
    columns["surface_of"] = [s + np.int32(n) for s, n in zip(columns["surface_of"], counts[:-1], strict=True)]
    return Mesh(**{name: np.concatenate(parts) for name, parts in columns.items()})


@dataclass
class MeshBuilder:
    """Collects flat panels and free triangles, and numbers their surfaces; what is built gets its builder by `at`."""

    rng: np.random.Generator
    season: SeasonParams = field(default_factory=SeasonParams)
    is_clutter: bool = False  # whether what is added now comes and goes
    placement: Array = field(default_factory=lambda: np.eye(4))  # (4, 4): of the frame in which things are added
    lamps: list[Array] = field(default_factory=list)  # points (3,) below the heads of street lamps
    height: Callable[[Array], Array] | None = None  # of the ground, m, at x (N,): everything stands on it
    _triangles: list[Array] = field(default_factory=list)
    _surface_of: list[Integers] = field(default_factory=list)
    _surfaces: list[tuple[Array, Finish, int, bool]] = field(default_factory=list)

    def at(self, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> MeshBuilder:
        """Return what adds to the same collection around (x, y, z) m, turned by `yaw` radians."""
        return self.within(placed(x, y, yaw, z))

    def within(self, placement: Array) -> MeshBuilder:
        """Return what adds to the same collection in a frame that is placed by a matrix (4, 4)."""
        return replace(self, placement=self.placement @ placement)

    def clutter(self) -> MeshBuilder:
        """Return what adds to the same collection things that come and go."""
        return replace(self, is_clutter=True)

    def unseen(self) -> MeshBuilder:
        """Return what adds to nothing, but draws from the same generator: the rest of a world goes on alike."""
        return replace(self, _triangles=[], _surface_of=[], _surfaces=[])

    def drawn_by(self, rng: np.random.Generator) -> MeshBuilder:
        """Return what adds to the same collection, drawn from another generator."""
        return replace(self, rng=rng)

    def place(self, points: ArrayLike) -> Array:
        """Return where points (..., 3) of the frame are in the world."""
        return np.asarray(points, dtype=np.float64) @ self.placement[:3, :3].T + self.placement[:3, 3]

    def panels(self, corners: ArrayLike, finish: Finish) -> None:
        """Add flat quadrilaterals (N, 4, 3), counter-clockwise from outside, lower left first: N surfaces."""
        quads = self.place(corners).reshape(-1, 4, 3)
        first = self.num_surfaces
        for quad in quads:
            self._new_surface(quad[[0, 1, 3]], finish)
        self._add_quads(quads, np.arange(first, self.num_surfaces))

    def sheet(self, corners: ArrayLike, finish: Finish, frame: ArrayLike) -> None:
        """Add quadrilaterals (N, 4, 3) of one plane as one surface; frame (3, 3): origin, points along u and v."""
        quads = self.place(corners).reshape(-1, 4, 3)
        self._new_surface(self.place(frame), finish)
        self._add_quads(quads, np.full(len(quads), self.num_surfaces - 1))

    def solid(self, triangles: ArrayLike, finish: Finish) -> None:
        """Add free triangles (N, 3, 3) as one surface with texture in space, u, v, w = x, y, z."""
        faces = self.place(triangles)
        self._new_surface(self.place(np.zeros(3)) + np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), finish)
        self._triangles.append(faces)
        self._surface_of.append(np.full(len(faces), self.num_surfaces - 1))

    def box(self, low: ArrayLike, size: ArrayLike, finish: Finish) -> None:
        """Add a box from corner `low` (3,), size (3,) m."""
        self.panels(np.asarray(low) + BOX_FACES * np.asarray(size), finish)

    @property
    def num_surfaces(self) -> int:
        """Number of surfaces so far."""
        return len(self._surfaces)

    def build(self) -> Mesh:
        """Return everything collected as arrays."""
        frames, finishes, seeds, is_clutter = zip(*self._surfaces, strict=True)
        triangles, corners = np.concatenate(self._triangles), np.stack(frames)
        if self.height is not None:
            for points in (triangles, corners):
                points[..., 2] += self.height(points[..., 0])
        edges = triangles[:, 1:] - triangles[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        area = np.linalg.norm(normals, axis=1)
        keep = area > 1e-10
        return Mesh(
            triangles=triangles[keep].astype(np.float32),
            normals=(normals[keep] / area[keep, None]).astype(np.float32),
            surface_of=np.concatenate(self._surface_of)[keep].astype(np.int32),
            frames=_frames(corners),
            kinds=np.array([(f.kind, seed) for f, seed in zip(finishes, seeds, strict=True)], np.int32),
            params=np.array([(*f.params, *(0.0,) * (NUM_PARAMS - len(f.params))) for f in finishes], np.float32),
            colors=np.array([(f.color, f.second) for f in finishes], np.float32),
            is_clutter=np.array(is_clutter, bool),
            lamps=np.array(self.lamps, np.float64).reshape(-1, 3),
        )

    def _new_surface(self, frame: Array, finish: Finish) -> None:
        seed = int(self.rng.integers(1, 1 << 20))
        self._surfaces.append((frame, finish, seed, self.is_clutter))

    def _add_quads(self, quads: Array, surfaces: Integers) -> None:
        self._triangles.append(halved(quads))
        self._surface_of.append(np.repeat(surfaces, 2))


def halved(quads: Array) -> Array:
    """Return the triangles (2 N, 3, 3) of quadrilaterals (N, 4, 3)."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def flat(x0: float, y0: float, x1: float, y1: float, z: float) -> Array:
    """Return the corners (4, 3) of a rectangle that faces up; down where y1 is below y0."""
    return np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])


def upright(x0: float, x1: float, z0: float, z1: float, y: float) -> Array:
    """Return the corners (4, 3) of a rectangle that faces -y: the street, of a front."""
    return np.array([[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]])


def placed(x: float, y: float, yaw: float, z: float = 0.0) -> Array:
    """Return the matrix (4, 4) of a thing standing at (x, y, z), turned by `yaw` radians."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]], dtype=np.float64)


def _frames(corners: Array) -> Floats:
    """Return world-to-surface (S, 3, 4) of origin, a point along u and a point on the v side, (S, 3, 3)."""
    origin = corners[:, 0]
    along = corners[:, 1] - origin
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = corners[:, 2] - origin
    up = side - np.sum(side * along, axis=1, keepdims=True) * along
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    R = np.stack([along, up, np.cross(along, up)], axis=1)
    return np.concatenate([R, -(R @ origin[..., None])], axis=2).astype(np.float32)
