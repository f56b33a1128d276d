"""Homes of a seed: floor plans of several kinds as a map, and what the plan does not know in the images.

The plan has walls, doors and openings of rooms, drawn a few centimetres wrong. The images also show furniture, door
leaves, windows with a view, glass walls and mirrors. Rays are cast by Embree and shaded here, so that a mirror is one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations, pairwise

import cv2
import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from mcl_depth.geometry.floor_plan import WallSurface, mesh_of
from mcl_depth.geometry.mesh import TriangleMesh
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays

KINDS = ("flat", "corridor", "open", "slanted", "cells")
PANORAMA = Spherical(512, 256)
HEIGHT = 1.435  # of the camera, m
HEIGHT_SIGMA, TILT_DEG = 0.01, 0.3  # of the tripod
PLAN_SIGMA = 0.02  # m, of the walls of a plan
WALL = 0.14  # between rooms, m
LEAST = 1.7  # side of a room, m
DOOR_TOP, DOOR_WIDTH = 2.03, (0.7, 0.9)
PLAIN, BOARDS, TILES, PICTURE, WINDOW, MIRROR, GLASS = range(7)
BOUNCES = 4  # of a ray in mirrors and through glass
Look = tuple[int, float, float, int]  # pattern, reflectance, scale, room
FURNITURE = (  # width along the wall, depth, bottom, top in m: from, to
    ((1.0, 2.4), (0.55, 0.65), (0.0, 0.0), (1.8, 2.25)),  # wardrobe
    ((1.4, 1.9), (1.9, 2.1), (0.0, 0.0), (0.4, 0.6)),  # bed
    ((1.5, 2.4), (0.8, 1.0), (0.0, 0.0), (0.7, 0.9)),  # sofa
    ((1.2, 3.0), (0.58, 0.64), (0.0, 0.0), (0.86, 0.92)),  # counter
    ((1.0, 3.0), (0.33, 0.38), (1.4, 1.5), (2.0, 2.2)),  # cupboards above it
    ((0.6, 1.2), (0.25, 0.4), (0.0, 0.0), (0.9, 2.0)),  # shelf
    ((0.9, 1.6), (0.7, 0.9), (0.70, 0.72), (0.74, 0.76)),  # table
    ((0.5, 0.6), (0.5, 0.6), (0.0, 0.0), (0.8, 1.0)),  # chair, machine
)


@dataclass
class Scene:
    """Rectangles (corners lower left, lower right, upper left) with a pattern, a reflectance and a room each."""

    corners: list[Array] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)

    def rectangle(self, corner: Array, along: Array, up: Array, look: Look) -> None:
        """Add a rectangle from a corner (3,) and its two sides (3,)."""
        self.corners.append(np.array([corner, corner + along, corner + up]))
        self.looks.append(look)

    def flat(self, corner: Array, along: Array, across: Array, z: float, look: Look) -> None:
        """Add a level rectangle from a corner (2,) and its two sides (2,)."""
        self.rectangle(np.append(corner, z), np.append(along, 0.0), np.append(across, 0.0), look)

    def panel(self, corner: Array, along: Array, z: tuple[float, float], look: Look) -> None:
        """Add an upright rectangle from a corner (2,) along (2,) between two heights."""
        self.rectangle(np.append(corner, z[0]), np.append(along, 0.0), np.array([0.0, 0.0, z[1] - z[0]]), look)

    def box(self, corner: Array, sides: Array, look: Look) -> None:
        """Add the six sides of a box: corner (3,), sides (3, 3)."""
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            self.rectangle(corner, sides[i], sides[j], look)
            self.rectangle(corner + sides[k], sides[i], sides[j], look)


@dataclass(frozen=True)
class Home:
    """A plan as a map, and pictures of its rooms: images (K, H, W), poses x, y, yaw (K, 3)."""

    plan: TriangleMesh
    images: NDArray[np.uint8]
    poses: Array


@lru_cache(maxsize=32)
def home(seed: int, num_images: int = 16) -> Home:
    """Return the home of a seed with so many pictures."""
    rng = np.random.default_rng([seed, 91])
    kind = KINDS[seed % len(KINDS)]
    cells = _cells(kind, rng)
    shear = np.array([[1.0, np.tan(rng.uniform(0.08, 0.2)) if kind == "slanted" else 0.0], [0.0, 1.0]])
    turn = rng.uniform(-np.pi, np.pi)
    shear = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ shear
    ceilings = rng.uniform(2.3, 2.75) + rng.choice([0.0, 0.0, -0.12, 0.1], len(cells))
    links = _links(cells, kind, rng)
    rings = [shear @ np.array([[x0, x1, x1, x0], [y0, y0, y1, y1]]) for x0, y0, x1, y1 in _inset(cells)]
    surfaces = list(_surfaces([ring.T for ring in rings], ceilings, links, shear))
    scene = Scene()
    _draw_shell(scene, surfaces, rings, ceilings, rng)
    _draw_doors(scene, links, shear, rng)
    clutter = rng.choice([0.0, 0.5, 1.0], p=[0.2, 0.4, 0.4])
    taken = []
    for i, (ring, top, is_outer) in enumerate(zip(rings, ceilings, _outer_sides(cells), strict=True)):
        doors = [np.stack([s.start, s.end]) for s in surfaces if s.room == str(i) and s.kind == "door"]
        taken.append(_furnish(scene, ring.T, i, float(top), is_outer, doors, clutter, rng))
    places = _places(rings, taken, num_images, rng)
    yaws = rng.uniform(-np.pi, np.pi, len(places))
    camera = _Caster(scene, [np.append(ring.mean(axis=1), top) for ring, top in zip(rings, ceilings, strict=True)], rng)
    images = np.stack([camera.image(place, yaw) for place, yaw in zip(places, yaws, strict=True)])
    return Home(mesh_of(_measured(surfaces, rng), f"home {seed}"), images, np.column_stack([places, yaws]))


def _cells(kind: str, rng: np.random.Generator) -> Array:
    """Return the rooms of a kind of home as rectangles (N, 4), x0, y0, x1, y1."""
    width, depth = rng.uniform(9.0, 15.0), rng.uniform(8.0, 11.0)
    if kind == "corridor":  # rooms of equal size on both sides
        count, hall = int(rng.integers(3, 5)), rng.uniform(1.7, 2.2)
        edges = np.linspace(0.0, count * rng.uniform(2.8, 3.8), count + 1)
        if rng.random() < 0.5:
            edges[1:-1] += rng.uniform(-0.4, 0.4, count - 1)
        deep = rng.uniform(3.0, 4.5, 2)
        rooms = [(a, -deep[0], b, 0.0) for a, b in pairwise(edges)]
        rooms += [(a, hall, b, hall + deep[1]) for a, b in pairwise(edges)]
        return np.array([(0.0, 0.0, edges[-1], hall), *rooms])
    count = {"flat": 7, "open": 4, "slanted": 6, "cells": 9}[kind]
    rooms = [(0.0, 0.0, width, depth)]
    while len(rooms) < count:
        sizes = [max(r[2] - r[0], r[3] - r[1]) for r in rooms]
        room = rooms.pop(int(np.argmax(sizes)))
        sides = room[2] - room[0], room[3] - room[1]
        axis = int(sides[1] > sides[0])
        if sides[axis] < 2.0 * LEAST + 0.2:
            rooms.append(room)
            break
        cut = room[axis] + np.clip(rng.uniform(0.3, 0.7) * sides[axis], LEAST, sides[axis] - LEAST)
        low, high = list(room), list(room)
        low[axis + 2], high[axis] = cut, cut
        rooms += [tuple(low), tuple(high)]
    if kind == "open" or (kind == "flat" and rng.random() < 0.5):  # a corner of the building is missing
        corner = [r for r in rooms if r[0] == 0.0 and r[1] == 0.0]
        rooms = [r for r in rooms if r not in corner] if len(rooms) > 3 else rooms
    return np.array(rooms)


def _inset(cells: Array) -> Array:
    return cells + 0.5 * WALL * np.array([1.0, 1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Link:
    """A hole between two rooms: in the wall at `at` of an axis, from `low` to `high` along the other one."""

    rooms: tuple[int, int]
    axis: int
    at: float
    low: float
    high: float
    top: float
    is_open: bool


def _links(cells: Array, kind: str, rng: np.random.Generator) -> list[Link]:
    """Return doors and openings: such that all rooms are joined by open ones, and some more."""
    found: list[tuple[Link, float]] = []
    for i, j in combinations(range(len(cells)), 2):
        for axis in (0, 1):
            other = 1 - axis
            for a, b in ((i, j), (j, i)):
                if abs(cells[a, axis + 2] - cells[b, axis]) > 1e-6:
                    continue
                low = max(cells[a, other], cells[b, other]) + 0.25
                high = min(cells[a, other + 2], cells[b, other + 2]) - 0.25
                if high - low < 0.8:
                    continue
                is_wide = kind == "open" and rng.random() < 0.7 and high - low > 1.4
                width = rng.uniform(0.6, 0.95) * (high - low) if is_wide else rng.uniform(*DOOR_WIDTH)
                start = rng.uniform(low, high - width)
                top = rng.uniform(2.05, 2.25) if is_wide else DOOR_TOP
                link = Link((i, j), axis, float(cells[a, axis + 2]), start, start + width, top, is_wide)
                found.append((link, 0.5 * rng.random() - float(kind == "corridor" and min(i, j) == 0)))
    joined, links = list(range(len(cells))), []
    for link, _ in sorted(found, key=lambda item: item[1]):
        a, b = (joined[k] for k in link.rooms)
        if a != b or rng.random() < 0.15:
            is_open = link.is_open or a != b or rng.random() < 0.5
            links.append(Link(*(*list(link.__dict__.values())[:-1], is_open)))
            joined = [a if name == b else name for name in joined]
    return links


def _surfaces(rings: list[Array], ceilings: Array, links: list[Link], warp: Array) -> list[WallSurface]:
    """Return walls and holes of all rooms, as a table of a plan has them."""
    found = []
    for i, (ring, top) in enumerate(zip(rings, ceilings, strict=True)):
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            found.append(WallSurface("wall", str(i), a, b, 0.0, float(top)))
        for link in links:
            if i in link.rooms:
                side = -0.5 if _is_below(ring, link, warp) else 0.5
                ends = np.array([[link.at + side * WALL, s] for s in (link.low, link.high)])
                ends = (ends if link.axis == 0 else ends[:, ::-1]) @ warp.T
                found.append(WallSurface("door", str(i), ends[0], ends[1], 0.0, min(link.top, float(top))))
    return found


def _is_below(ring: Array, link: Link, warp: Array) -> bool:
    """Whether a room lies on the low side of a hole."""
    return bool((np.linalg.inv(warp) @ ring.mean(axis=0))[link.axis] < link.at)


def _outer_sides(cells: Array) -> list[list[bool]]:
    """Return for each room which of its four walls (below, right, above, left) no other room is behind, midway."""
    sides = []
    for x0, y0, x1, y1 in cells:
        x, y, e = 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.3
        outside = ((x, y0 - e), (x1 + e, y), (x, y1 + e), (x0 - e, y))
        sides.append([not any(c[0] < p < c[2] and c[1] < q < c[3] for c in cells) for p, q in outside])
    return sides


def _measured(surfaces: list[WallSurface], rng: np.random.Generator) -> list[WallSurface]:
    """Return surfaces as somebody measured them; rings stay closed, as rooms move as a whole."""
    off = {room: PLAN_SIGMA * rng.standard_normal(3) for room in dict.fromkeys(s.room for s in surfaces)}
    found = []
    for s in surfaces:
        shift, top = off[s.room][:2], s.top + (off[s.room][2] if s.kind == "wall" else 0.0)
        found.append(WallSurface(s.kind, s.room, s.start + shift, s.end + shift, s.bottom, top))
    return found


def _draw_shell(
    scene: Scene, surfaces: list[WallSurface], rings: list[Array], ceilings: Array, rng: np.random.Generator
) -> None:
    """Draw floors, ceilings, and walls around their holes."""
    for i, (ring, top) in enumerate(zip(rings, ceilings, strict=True)):
        corner, along, across = ring[:, 0], ring[:, 1] - ring[:, 0], ring[:, 3] - ring[:, 0]
        floor = (int(rng.choice([BOARDS, TILES, PLAIN])), rng.uniform(0.15, 0.5), rng.uniform(0.1, 0.4), i)
        scene.flat(corner, along, across, 0.0, floor)
        scene.flat(corner, along, across, top, (PLAIN, rng.uniform(0.7, 0.85), 1.0, i))
        paint, own = rng.uniform(0.4, 0.8), [s for s in surfaces if s.room == str(i)]
        for wall in (s for s in own if s.kind == "wall"):
            look = (PLAIN, paint * rng.uniform(0.95, 1.05), 1.0, i)
            _draw_wall(scene, wall, [s for s in own if s.kind == "door"], look)


def _draw_wall(scene: Scene, wall: WallSurface, doors: list[WallSurface], look: Look) -> None:
    length = float(np.linalg.norm(wall.end - wall.start))
    along = (wall.end - wall.start) / length
    across = np.array([-along[1], along[0]])
    cuts = []
    for door in doors:
        ends = np.stack([door.start, door.end]) - wall.start
        if np.abs(ends @ across).max() < 0.02:
            cuts.append((*np.sort(ends @ along), door.top))
    edge = 0.0
    for low, high, top in [*sorted(cuts), (length, length, wall.top)]:
        for a, b, bottom in ((edge, low, 0.0), (low, high, top)):
            if b - a > 1e-3 and wall.top - bottom > 1e-3:
                scene.panel(wall.start + a * along, (b - a) * along, (bottom, wall.top), look)
        edge = high


def _draw_doors(scene: Scene, links: list[Link], warp: Array, rng: np.random.Generator) -> None:
    """Draw the sides of holes, and leaves, closed or open."""
    for link in links:
        paint, half = (PLAIN, rng.uniform(0.2, 0.8), 1.0, link.rooms[0]), 0.5 * WALL

        def at(across: float, along: float, link: Link = link) -> Array:
            xy = np.array([link.at + across, along])
            return warp @ (xy if link.axis == 0 else xy[::-1])

        low, high = link.low, link.high
        for s in (low, high):
            scene.panel(at(-half, s), at(half, s) - at(-half, s), (0.0, link.top), paint)
        for z in (0.0, link.top):
            scene.flat(at(-half, low), at(half, low) - at(-half, low), at(-half, high) - at(-half, low), z, paint)
        if high - low <= DOOR_WIDTH[1]:
            angle = rng.uniform(np.radians(60.0), np.radians(100.0)) if link.is_open else 0.0
            into = half if rng.random() < 0.5 else -half
            tip = at(into + np.sign(into) * np.sin(angle) * (high - low), low + np.cos(angle) * (high - low))
            scene.panel(at(into, low), tip - at(into, low), (0.01, link.top), paint)


def _furnish(
    scene: Scene,
    ring: Array,
    room: int,
    ceiling: float,
    is_outer: list[bool],
    doors: list[Array],
    clutter: float,
    rng: np.random.Generator,
) -> list[Array]:
    """Put windows, mirrors, pictures and furniture along the walls; return the rectangles (4, 2) that stand there."""
    taken: list[Array] = []
    middle = ring.mean(axis=0)
    for index, (a, b) in enumerate(zip(ring, np.roll(ring, -1, axis=0), strict=True)):
        length = float(np.linalg.norm(b - a))
        along = (b - a) / length
        inward = np.array([-along[1], along[0]])
        inward *= np.sign(inward @ (middle - a))
        depth = 2.0 * float(inward @ (middle - a))
        blocked = [np.sort((door - a) @ along) for door in doors if np.abs((door - a) @ inward).max() < 0.2]
        low, width, z, look = _on_wall(is_outer[index], length, ceiling, room, rng)
        hung = [(low, width, z, look)] if width else []
        for _ in range(int(rng.poisson(0.8 * clutter))):
            width, height = rng.uniform(0.3, 1.2), rng.uniform(0.3, 0.9)
            low = rng.uniform(0.1, max(length - width - 0.1, 0.11))
            hung.append((low, width, (1.8 - height, 1.8), (PICTURE, rng.uniform(0.1, 0.9), width, room)))
        for low, width, z, look in hung:
            if _is_clear(low, low + width, blocked) and width < length - 0.2:
                scene.panel(a + low * along + 0.012 * inward, width * along, z, look)
        for _ in range(int(rng.poisson(1.6 * clutter))):
            width, deep, bottom, top = (rng.uniform(*limits) for limits in FURNITURE[int(rng.integers(len(FURNITURE)))])
            low = 0.05 + rng.random() * (length - width - 0.1)
            ends = ((low, 0.02), (low + width, 0.02), (low + width, deep), (low, deep))
            foot = np.array([a + s * along + t * inward for s, t in ends])
            is_in_way = top < 1.3 and any(_overlap(foot, other) for other in taken)
            fits = width < length - 0.1 and deep < 0.6 * depth and depth - deep > 1.0
            if fits and not is_in_way and _is_clear(low, low + width, blocked):
                taken.append(foot)
                sides = np.array([[*(foot[1] - foot[0]), 0.0], [*(foot[3] - foot[0]), 0.0], [0.0, 0.0, top - bottom]])
                look = (
                    int(rng.choice([PLAIN, PICTURE, BOARDS], p=[0.7, 0.15, 0.15])),
                    rng.uniform(0.05, 0.8),
                    0.6,
                    room,
                )
                scene.box(np.append(foot[0], bottom), sides, look)
    if any(is_outer) and rng.random() < 0.5:  # sun on the floor
        at = ring[0] + rng.uniform(0.1, 0.6) * (ring[1] - ring[0]) + rng.uniform(0.1, 0.6) * (ring[3] - ring[0])
        along, across = rng.uniform(-1.0, 1.0, (2, 2))
        scene.flat(at, along, across, 0.004, (PLAIN, 1.5, 1.0, room))
    if rng.random() < 0.6:  # a lamp
        at = np.append(middle + rng.uniform(-0.3, 0.3, 2), ceiling - rng.uniform(0.1, 0.5))
        scene.box(at, np.diag([0.3, 0.3, 0.12]), (PLAIN, 0.95, 1.0, room))
    return taken


def _on_wall(
    is_outer: bool, length: float, ceiling: float, room: int, rng: np.random.Generator
) -> tuple[float, float, tuple[float, float], Look]:
    """Return begin, width, heights and look of a window, a mirror or a wall of glass; of width 0: none."""
    draw = rng.random()
    if is_outer and draw < 0.75:
        width = min(rng.uniform(0.8, 2.4), length - 0.4)
        sill = 0.05 if rng.random() < 0.25 else rng.uniform(0.8, 1.0)
        top = min(rng.uniform(2.0, 2.2), ceiling - 0.05)
        return (
            0.2 + rng.random() * (length - width - 0.4),
            width,
            (sill, top),
            (WINDOW, rng.uniform(0.5, 0.9), width, room),
        )
    if draw < 0.12:
        width = min(rng.uniform(0.6, 2.0), length - 0.4)
        low = 0.2 + rng.random() * (length - width - 0.4)
        return low, width, (0.05 if rng.random() < 0.4 else 1.0, 2.0), (MIRROR, 0.9, width, room)
    if draw < 0.17 and length > 2.0 and not is_outer:
        return 0.3, length - 0.6, (0.05, ceiling - 0.2), (GLASS, 0.9, 1.0, room)
    return 0.0, 0.0, (0.0, 0.0), (PLAIN, 0.0, 0.0, room)


def _is_clear(low: float, high: float, blocked: list[Array]) -> bool:
    """Whether a part of a wall is beside all of its doors."""
    return all(high < door[0] - 0.1 or low > door[1] + 0.1 for door in blocked)


def _overlap(first: Array, second: Array) -> bool:
    """Whether the middle of one rectangle lies close to the other's."""
    away = np.linalg.norm(first.mean(axis=0) - second.mean(axis=0))
    return bool(away < 0.35 * (np.ptp(first, axis=0).max() + np.ptp(second, axis=0).max()))


def _places(rings: list[Array], taken: list[list[Array]], count: int, rng: np.random.Generator) -> Array:
    """Return where pictures are taken (count, 2): each room once, then by area."""
    sides = [np.linalg.norm(ring[:, 1] - ring[:, 0]) * np.linalg.norm(ring[:, 3] - ring[:, 0]) for ring in rings]
    order = [*rng.permutation(len(rings)), *rng.choice(len(rings), 4 * count, p=np.array(sides) / sum(sides))]
    found: list[Array] = []
    for room in np.repeat(order, 20):
        ring = rings[room]
        along, across = ring[:, 1] - ring[:, 0], ring[:, 3] - ring[:, 0]
        margins = 0.5 / np.linalg.norm(along), 0.5 / np.linalg.norm(across)
        s, t = (np.clip(rng.random(), margin, 1.0 - margin) for margin in margins)
        place = ring[:, 0] + s * along + t * across
        point = place.astype(np.float32).tolist()
        near = [cv2.pointPolygonTest(foot.astype(np.float32), point, True) for foot in taken[room]]
        if all(value < -0.25 for value in near) and all(np.linalg.norm(place - other) > 0.7 for other in found):
            found.append(place)
        if len(found) == count:
            break
    return np.array(found)


class _Caster:
    """Draws panoramas of a scene: lamps (R, 3), one a room."""

    def __init__(self, scene: Scene, lamps: list[Array], rng: np.random.Generator) -> None:
        corners, looks = np.array(scene.corners), np.array(scene.looks)
        self._corner = corners[:, 0]
        self._along, self._up = corners[:, 1] - self._corner, corners[:, 2] - self._corner
        quads = np.stack([self._corner, corners[:, 1], corners[:, 1] + self._up, corners[:, 2]], axis=1)
        triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3).astype(np.float32)
        self._scene = EmbreeScene(robust=True)
        self._keep = EmbreeMesh(self._scene, triangles)
        self._kind, self._room = looks[:, 0].astype(int), looks[:, 3].astype(int)
        self._base, self._scale = looks[:, 1], looks[:, 2]
        normals = np.cross(self._along, self._up)
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self._lamps = np.array(lamps) - [0.0, 0.0, 0.15]
        self._power, self._ambient = rng.uniform(0.5, 1.5, len(lamps)), rng.uniform(0.3, 0.9, len(lamps))
        self._side = rng.uniform(-1.0, 1.0, 3) * [1.0, 1.0, 0.2]
        self._outside = rng.uniform(0.3, 1.2, 48)  # heights of what is seen through windows
        self._rng = rng
        self._rays = pixel_rays(PANORAMA).reshape(-1, 3)

    def image(self, place: Array, yaw: float) -> NDArray[np.uint8]:
        """Return the grey panorama (H, W) at x, y (2,) with a heading."""
        roll, pitch = np.radians(TILT_DEG) * self._rng.standard_normal(2)
        R = SE3.from_planar(0.0, 0.0, float(yaw)).rotation @ cv2.Rodrigues(np.array([roll, pitch, 0.0]))[0]
        origin = np.append(place, HEIGHT + HEIGHT_SIGMA * self._rng.standard_normal())
        light = self._radiance(np.tile(origin, (len(self._rays), 1)), self._rays @ R.T)
        light = light / np.median(light) * self._rng.uniform(0.12, 0.3)
        levels = (255.0 * np.clip(light, 0.0, 1.0) ** (1.0 / 2.2)).reshape(PANORAMA.height, PANORAMA.width)
        return np.clip(np.rint(levels + 2.0 * self._rng.standard_normal(levels.shape)), 0, 255).astype(np.uint8)

    def _radiance(self, starts: Array, rays: Array) -> Array:
        light, share = np.zeros(len(rays)), np.ones(len(rays))
        todo = np.arange(len(rays))
        for _ in range(BOUNCES):
            hits = self._scene.run(starts.astype(np.float32), rays.astype(np.float32), query="INTERSECT", output=1)
            index, away = hits["primID"] // 2, hits["tfar"].astype(np.float64)
            is_out = hits["primID"] < 0
            points = starts + np.where(is_out, 0.0, away)[:, None] * rays
            kind = np.where(is_out, WINDOW, self._kind[index])
            found = np.where(is_out, self._sky(rays), self._shade(index, points, rays))
            goes_on = np.isin(kind, (MIRROR, GLASS)) & ~is_out
            light[todo[~goes_on]] += (share[todo] * found)[~goes_on]
            share[todo[goes_on]] *= 0.9
            rays, points, index, kind = rays[goes_on], points[goes_on], index[goes_on], kind[goes_on]
            todo = todo[goes_on]
            if not len(todo):
                break
            normals = self._normals[index]
            is_mirror = (kind == MIRROR)[:, None]
            rays = np.where(is_mirror, rays - 2.0 * np.sum(rays * normals, axis=1, keepdims=True) * normals, rays)
            starts = points + 0.03 * rays
        light[todo] += 0.1 * share[todo]
        return light

    def _shade(self, index: NDArray[np.int64], points: Array, rays: Array) -> Array:
        """Return the radiance (N,) of surfaces at points (N, 3)."""
        normals = self._normals[index]
        normals = -normals * np.sign(np.sum(normals * rays, axis=1, keepdims=True))
        room = self._room[index]
        to_lamp = self._lamps[room] - points
        away = np.linalg.norm(to_lamp, axis=1)
        lamp = np.maximum(np.sum(normals * to_lamp, axis=1), 0.05 * away) / np.maximum(away, 0.5) ** 3
        lamp *= self._power[room]
        ambient = self._ambient[room] * (1.0 + 0.25 * normals @ self._side)
        offset = points - self._corner[index]
        width, height = np.linalg.norm(self._along[index], axis=1), np.linalg.norm(self._up[index], axis=1)
        u = np.sum(offset * self._along[index], axis=1) / width
        v = np.sum(offset * self._up[index], axis=1) / height
        kind, scale, salt = self._kind[index], self._scale[index], (7.31 * index).astype(np.float64)
        pattern = 1.0 + 0.03 * np.sin(2.1 * u + salt) * np.sin(1.7 * v + 2.0 * salt)
        board = _noise(np.floor(v / 0.12), np.floor(u / 0.9 + 0.37 * np.floor(v / 0.12)), salt)
        tile = np.where((np.mod(u, 0.33) < 0.012) | (np.mod(v, 0.33) < 0.012), 0.75, 1.0)
        picture = 0.6 + 0.8 * _noise(np.floor(4.0 * u / scale), np.floor(4.0 * v / scale), salt)
        pattern = np.where(kind == BOARDS, 0.85 + 0.3 * board, pattern)
        pattern = np.where(kind == TILES, tile, np.where(kind == PICTURE, picture, pattern))
        light = self._base[index] * pattern * (ambient + lamp)
        edge = np.minimum(np.minimum(u, width - u), np.minimum(v, height - v))
        is_frame = (edge < 0.05) | ((width > 1.2) & (np.abs(u - 0.5 * width) < 0.03))
        window = np.where(is_frame, self._base[index] * ambient, self._sky(rays))
        return np.where(kind == WINDOW, window, light)

    def _sky(self, rays: Array) -> Array:
        """Return the radiance (N,) of what is outside: sky over houses and trees."""
        azimuth = (np.arctan2(rays[:, 1], rays[:, 0]) / (2.0 * np.pi) % 1.0) * len(self._outside)
        tall = 0.25 * self._outside[azimuth.astype(int) % len(self._outside)]
        return np.where(rays[:, 2] > tall, 4.0, 0.6 * self._outside[(azimuth * 3).astype(int) % len(self._outside)])


def _noise(a: Array, b: Array, c: Array) -> Array:
    """Return numbers in [0, 1) that look random."""
    value = np.sin(a * 12.9898 + b * 78.233 + c * 37.719) * 43758.5453
    return value - np.floor(value)
