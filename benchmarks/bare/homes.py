"""Homes searched from nowhere: walks through panoramas, in their plan and in that of another home; a real one, too.

A plan has walls and doors of rooms, drawn a few centimetres wrong; the images also show furniture, windows and pictures
on the walls. Walks go from a panorama to the nearest one not visited yet, with odometry of 5 % and 3 degrees. The real
home's truth and plan are of its recording.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.bare.drives import NEAR_M, READ_NOISE, SHOT_NOISE, Step, Trial, run_filter
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.imaging import expose
from cycab_sim.world import finishes
from cycab_sim.world.mesh import Finish, MeshBuilder
from cycab_sim.world.texture import kernels as k
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from mcl_depth.geometry.cloud import Geometry
from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.floor_plan import WallSurface, mesh_of
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.encoded import read_image_file

KINDS = ("flat", "corridor", "open", "cells")
PANORAMA = Spherical(512, 256)
HEIGHT, HEIGHT_SIGMA, TILT_DEG = 1.435, 0.01, 0.3  # m, m, deg: of the camera and its tripod
PLAN_SIGMA, WALL, LEAST = 0.02, 0.14, 1.7  # m: of the walls of a plan, between rooms, side of a room
DOOR_TOP, DOOR_WIDTH, CLEAR_M = 2.03, (0.7, 0.9), 0.25  # m; from the camera to furniture
WINDOW = Finish(k.MARKING, (0.95, 0.95, 0.95), (0.95, 0.95, 0.95), (0.0, 1.0, 1.0))
FURNITURE = (  # width along the wall, depth, bottom, top in m: from, to
    ((1.0, 2.4), (0.55, 0.65), (0.0, 0.0), (1.8, 2.25)),  # wardrobe
    ((1.4, 1.9), (1.9, 2.1), (0.0, 0.0), (0.4, 0.6)),  # bed
    ((1.5, 2.4), (0.8, 1.0), (0.0, 0.0), (0.7, 0.9)),  # sofa
    ((1.2, 3.0), (0.58, 0.64), (0.0, 0.0), (0.86, 0.92)),  # counter
    ((1.0, 3.0), (0.33, 0.38), (1.4, 1.5), (2.0, 2.2)),  # cupboards above it
    ((0.6, 1.2), (0.25, 0.4), (0.0, 0.0), (0.9, 2.0)),  # shelf
)
WALK, PUBLISHED_BY = 8, 15  # panoramas after which the place is asked for, and until a pose is published
CLOSE, MAX_CPU_MS = 0.5, 100.0  # m off the truth; of an image while the place is searched
PACE = 2.0  # m/s
COUNTS = {"quick": (2, 2, 2), "full": (10, 16, 16)}  # homes, walks in each, walks in the real one
HEAD = ("map", "walks", "within 1 m", "within 0.5 m", "published", "wrong poses", "CPU ms")


@dataclass(frozen=True)
class Home:
    """A plan as a map, and pictures of its rooms: images (K, H, W), poses x, y, yaw (K, 3)."""

    plan: Geometry
    images: NDArray[np.uint8]
    poses: Array


@dataclass(frozen=True)
class Door:
    """A hole between two rooms, across `axis` at `at`, from `low` to `high` along the other axis."""

    rooms: tuple[int, int]
    axis: int
    at: float
    low: float
    high: float

    def ends(self, side: float) -> Array:
        """Return both ends (2, 2) on the wall that is so far from the middle of it."""
        ends = np.array([[self.at + side, s] for s in (self.low, self.high)])
        return ends if self.axis == 0 else ends[:, ::-1]


@lru_cache(maxsize=32)
def home(seed: int, num_images: int = 16) -> Home:
    """Return the home of a seed with so many pictures."""
    rng = np.random.default_rng([seed, 91])
    cells = _cells(KINDS[seed % len(KINDS)], rng)
    doors = _doors(cells, rng)
    tops = rng.uniform(2.3, 2.75) + rng.choice([0.0, 0.0, -0.12, 0.1], len(cells))
    rooms = cells + 0.5 * WALL * np.array([1.0, 1.0, -1.0, -1.0])
    surfaces = [surface for i in range(len(rooms)) for surface in _surfaces(i, rooms[i], float(tops[i]), doors)]
    builder, taken = MeshBuilder(rng), [list[Array]() for _ in rooms]
    _draw_jambs(builder, doors, rng)
    for i, room in enumerate(rooms):
        _draw_room(builder, room, float(tops[i]), [s for s in surfaces if s.room == str(i)], rng)
        taken[i] = _furnish(builder, room, [s for s in surfaces if s.room == str(i)], rng)
    renderer = Renderer(builder.build(), RenderParams(shadow_texel=0.0), LightParams(exposure=rng.uniform(0.6, 1.6)))
    places = _places(rooms, taken, num_images, rng)
    yaws, images = rng.uniform(-np.pi, np.pi, len(places)), []
    for number, (place, yaw) in enumerate(zip(places, yaws, strict=True)):
        lean = SE3.exp([0.0, 0.0, 0.0, *(np.radians(TILT_DEG) * rng.standard_normal(2)), 0.0])
        z = HEIGHT + HEIGHT_SIGMA * rng.standard_normal()
        T = (
            SE3.from_planar(float(place[0]), float(place[1]), float(yaw))
            @ SE3.from_parts(np.eye(3), [0.0, 0.0, z])
            @ lean
        )
        levels, _ = renderer.render(PANORAMA, T, is_gray=True)
        images.append(expose(levels, READ_NOISE, SHOT_NOISE, (seed, number)))
    off = PLAN_SIGMA * rng.standard_normal((len(rooms), 3))
    plan = [_measured(surface, off[int(surface.room)]) for surface in surfaces]
    return Home(mesh_of(plan, f"home {seed}"), np.stack(images), np.column_stack([places, yaws]))


def _cells(kind: str, rng: np.random.Generator) -> Array:
    """Return the rooms of a kind of home as rectangles (N, 4), x0, y0, x1, y1."""
    width, depth = rng.uniform(9.0, 15.0), rng.uniform(8.0, 11.0)
    if kind == "corridor":  # rooms of about equal size on both sides
        count, hall = int(rng.integers(3, 5)), rng.uniform(1.7, 2.2)
        edges = np.linspace(0.0, count * rng.uniform(2.8, 3.8), count + 1)
        edges[1:-1] += rng.uniform(-0.4, 0.4, count - 1)
        deep = rng.uniform(3.0, 4.5, 2)
        rooms = [(a, -deep[0], b, 0.0) for a, b in pairwise(edges)]
        rooms += [(a, hall, b, hall + deep[1]) for a, b in pairwise(edges)]
        return np.array([(0.0, 0.0, edges[-1], hall), *rooms])
    rooms = [(0.0, 0.0, width, depth)]
    while len(rooms) < {"flat": 7, "open": 4, "cells": 9}[kind]:
        room = rooms.pop(int(np.argmax([max(r[2] - r[0], r[3] - r[1]) for r in rooms])))
        sides = room[2] - room[0], room[3] - room[1]
        axis = int(sides[1] > sides[0])
        if sides[axis] < 2.0 * LEAST + 0.2:
            rooms.append(room)
            break
        cut = room[axis] + np.clip(rng.uniform(0.3, 0.7) * sides[axis], LEAST, sides[axis] - LEAST)
        low, high = list(room), list(room)
        low[axis + 2], high[axis] = cut, cut
        rooms += [tuple(low), tuple(high)]
    return np.array(rooms)


def _doors(cells: Array, rng: np.random.Generator) -> list[Door]:
    """Return doors such that all rooms are joined, and some more."""
    found = []
    for i, j in combinations(range(len(cells)), 2):
        for axis, (a, b) in ((axis, pair) for axis in (0, 1) for pair in ((i, j), (j, i))):
            low = max(cells[a, 1 - axis], cells[b, 1 - axis]) + 0.25
            high = min(cells[a, 3 - axis], cells[b, 3 - axis]) - 0.25
            if abs(cells[a, axis + 2] - cells[b, axis]) < 1e-6 and high - low > DOOR_WIDTH[1]:
                width = rng.uniform(*DOOR_WIDTH)
                start = rng.uniform(low, high - width)
                found.append(Door((a, b), axis, float(cells[a, axis + 2]), start, start + width))
    joined, doors = list(range(len(cells))), []
    for door in (found[n] for n in rng.permutation(len(found))):
        a, b = (joined[room] for room in door.rooms)
        if a != b or rng.random() < 0.15:
            doors.append(door)
            joined = [a if name == b else name for name in joined]
    return doors


def _surfaces(number: int, room: Array, top: float, doors: list[Door]) -> Iterator[WallSurface]:
    """Yield walls, clockwise from above, and holes of a room, as a table of a plan has them."""
    x0, y0, x1, y1 = room
    ring = np.array([[x0, y0], [x0, y1], [x1, y1], [x1, y0]])
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        yield WallSurface("wall", str(number), a, b, 0.0, top)
    for door in doors:
        if number in door.rooms:
            a, b = door.ends(-0.5 * WALL if number == door.rooms[0] else 0.5 * WALL)
            yield WallSurface("door", str(number), a, b, 0.0, DOOR_TOP)


def _measured(s: WallSurface, off: Array) -> WallSurface:
    """Return a surface as somebody measured it: rooms move as a whole, so rings stay closed."""
    top = s.top + (off[2] if s.kind == "wall" else 0.0)
    return WallSurface(s.kind, s.room, s.start + off[:2], s.end + off[:2], s.bottom, top)


def _panel(builder: MeshBuilder, a: Array, b: Array, bottom: float, top: float, finish: Finish) -> None:
    """Add an upright rectangle from `a` to `b` (2,), seen from the right of this way."""
    builder.panels([[*a, bottom], [*b, bottom], [*b, top], [*a, top]], finish)


def _draw_room(
    builder: MeshBuilder, room: Array, top: float, surfaces: list[WallSurface], rng: np.random.Generator
) -> None:
    """Draw floor, ceiling, walls around their holes, windows and pictures."""
    x0, y0, x1, y1 = room
    floor = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
    builder.panels(floor, finishes.PAVING if rng.random() < 0.5 else finishes.ASPHALT)
    builder.panels(np.add(floor[::-1], [0.0, 0.0, top]), finishes.wall(rng))
    paint, doors = finishes.wall(rng), [s for s in surfaces if s.kind == "door"]
    for wall in (s for s in surfaces if s.kind == "wall"):
        length, edge = float(np.linalg.norm(wall.end - wall.start)), 0.0
        along = (wall.end - wall.start) / length
        cuts = _cuts(wall, doors)
        for low, high in [*cuts, (length, length)]:
            for a, b, bottom in ((edge, low, 0.0), (low, high, DOOR_TOP)):
                if b - a > 1e-3:
                    _panel(builder, wall.start + a * along, wall.start + b * along, bottom, top, paint)
            edge = high
        width = rng.uniform(0.5, 2.0)
        low = 0.2 + rng.random() * max(length - width - 0.4, 0.0)
        if width < length - 0.4 and all(low + width < a or low > b for a, b in cuts) and rng.random() < 0.7:
            off = wall.start + 0.012 * np.array([along[1], -along[0]])
            look = WINDOW if rng.random() < 0.4 else finishes.sign(width, 1.0, rng, 2)
            _panel(builder, off + low * along, off + (low + width) * along, 0.9, 1.9, look)


def _cuts(wall: WallSurface, doors: list[WallSurface]) -> list[tuple[float, float]]:
    """Return where a wall has holes, m from its start."""
    along = (wall.end - wall.start) / np.linalg.norm(wall.end - wall.start)
    ends = [np.stack([door.start, door.end]) - wall.start for door in doors]
    found = [np.sort(e @ along) for e in ends if np.abs(e @ [along[1], -along[0]]).max() < 1e-6]
    return sorted((float(low), float(high)) for low, high in found)


def _draw_jambs(builder: MeshBuilder, doors: list[Door], rng: np.random.Generator) -> None:
    """Draw the sides, thresholds and lintels of holes, from both sides."""
    for door in doors:
        paint, (a, b), (c, d) = finishes.wall(rng), door.ends(-0.5 * WALL), door.ends(0.5 * WALL)
        for p, q in ((a, c), (c, a), (b, d), (d, b)):
            _panel(builder, p, q, 0.0, DOOR_TOP, paint)
        for z in (0.0, DOOR_TOP):
            flat = np.array([[*p, z] for p in (a, b, d, c)])
            builder.panels([flat, flat[::-1]], paint)


def _furnish(builder: MeshBuilder, room: Array, surfaces: list[WallSurface], rng: np.random.Generator) -> list[Array]:
    """Put furniture along the walls; return the rectangles x0, y0, x1, y1 that are taken."""
    taken: list[Array] = []
    doors = [s for s in surfaces if s.kind == "door"]
    for wall in (s for s in surfaces if s.kind == "wall"):
        length = float(np.linalg.norm(wall.end - wall.start))
        along = (wall.end - wall.start) / length
        inward = np.array([along[1], -along[0]])
        depth = float(np.abs(inward @ (room[2:] - room[:2])))
        for _ in range(int(rng.poisson(1.2))):
            width, deep, bottom, top = (rng.uniform(*limits) for limits in FURNITURE[int(rng.integers(len(FURNITURE)))])
            low = 0.05 + rng.random() * max(length - width - 0.1, 0.0)
            corners = wall.start + np.array([low * along, (low + width) * along + deep * inward])
            foot = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
            is_clear = all(low + width < a - 0.1 or low > b + 0.1 for a, b in _cuts(wall, doors))
            is_free = all(np.any(foot[2:] < t[:2]) or np.any(foot[:2] > t[2:]) for t in taken)
            if is_clear and is_free and width < length - 0.1 and depth - deep > 1.0:
                taken.append(foot)
                look = finishes.painted_metal(finishes.pick(rng, finishes.WOODWORK))
                builder.box([*foot[:2], bottom], [*(foot[2:] - foot[:2]), top - bottom], look)
    return taken


def _places(rooms: Array, taken: list[list[Array]], count: int, rng: np.random.Generator) -> Array:
    """Return where pictures are taken (count, 2): each room once, then by area."""
    areas = (rooms[:, 2] - rooms[:, 0]) * (rooms[:, 3] - rooms[:, 1])
    order = [*rng.permutation(len(rooms)), *rng.choice(len(rooms), 4 * count, p=areas / areas.sum())]
    found: list[Array] = []
    for room in np.repeat(order, 20):
        place = rng.uniform(rooms[room, :2] + 0.5, rooms[room, 2:] - 0.5)
        beside = [np.any(place < t[:2] - CLEAR_M) or np.any(place > t[2:] + CLEAR_M) for t in taken[room]]
        if all(beside) and all(np.linalg.norm(place - other) > 0.7 for other in found):
            found.append(place)
        if len(found) == count:
            break
    return np.array(found)


def run(options: argparse.Namespace) -> Report:
    """Walk in each home, in its own plan and in that of the next one."""
    num_homes, num_walks, num_real = COUNTS[options.size]
    rows, right, wrong = [], list[Trial](), list[Trial]()
    for number in range(num_homes):
        here, other = home(options.seed + number), home(options.seed + (number + 1) % num_homes)
        for seen, found, what in ((here, right, "its own plan"), (other, wrong, "the plan of another")):
            walks = walk(here.plan, seen, num_walks, options.seed + number)
            rows.append((f"home {options.seed + number}, {what}", *_figures(walks)))
            found += walks
    report = Report("homes", notes=[__doc__ or ""])
    report.bounds += _bounds(f"{num_homes} homes, {len(right)} walks", right)
    claimed = sum(bool(one.is_trusted.any()) for one in wrong)
    report.bounds.append(Bound(f"{len(wrong)} walks in another's plan: ever a pose", 0.0, claimed, ""))
    folder = options.data / "panoramas_in_floor_plan"
    if folder.is_dir():
        real = read_home(folder)
        walks = walk(real.plan, real, num_real, options.seed)
        rows.append(("a real home", *_figures(walks)))
        report.bounds += _bounds(f"a real home, {len(walks)} walks", walks)
    report.tables.append(Table(f"after {WALK} panoramas; published by {PUBLISHED_BY}", HEAD, rows))
    return report


def walk(plan: Geometry, seen: Home, count: int, seed: int) -> list[Trial]:
    """Walk from so many panoramas; images of another home are wrong wherever they are claimed to be."""
    site, found = Site(plan, PANORAMA, HEIGHT, FilterParams()), []
    for number in range(count):
        again, start = divmod(number, len(seen.poses))  # the second walk from a panorama is another one
        found.append(run_filter(site, steps(seen, start, seed + 1000 * again), seed + 1000 * again))
    return found


def read_home(folder: Path) -> Home:
    """Read the panoramas; the pose of the level camera follows from the plan's conventions.

    Its azimuth grows to the right, so the plan is a mirror image of the home: the pictures are mirrored, too.
    """
    images, poses = [], []
    with (folder / "poses.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            image = read_image_file(folder / "images" / row["image"], cv2.IMREAD_GRAYSCALE)
            yaw = np.radians(90.0 + float(row["rotation_deg"]))  # the centre column looks along the local y axis
            poses.append((float(row["x_m"]), float(row["y_m"]), yaw))
            images.append(np.ascontiguousarray(image[:, ::-1]))
    return Home(read_geometry(folder / "surfaces.csv"), np.stack(images), np.array(poses))


def steps(seen: Home, start: int, seed: int) -> Iterator[Step]:
    """Yield what a filter takes on a walk from panorama `start`, and the true pose (3,)."""
    rng, camera = np.random.default_rng([seed, start]), Spherical(*seen.images.shape[:0:-1])
    odometry, before, seconds = np.zeros(3), seen.poses[start], 1.0
    for index, number in enumerate(_route(seen.poses[:, :2], start)):
        true = seen.poses[number]
        motion = relative_motion(before, true)
        motion[:2] *= 1.0 + 0.05 * rng.standard_normal()
        seconds += max(float(np.hypot(motion[0], motion[1])) / PACE, 0.5)
        motion[2] += np.radians(3.0) * rng.standard_normal() * (index > 0)
        odometry, before = compose_planar(odometry[None], motion)[0], true
        yield Observation(seen.images[number], camera, int(seconds * 1e9), np.eye(3), odometry), true


def _route(xy: Array, start: int) -> list[int]:
    """Return a walk to the nearest panorama not visited yet, again and again."""
    visited = [start]
    while len(visited) < min(PUBLISHED_BY, len(xy)):
        away = np.linalg.norm(xy - xy[visited[-1]], axis=1)
        away[visited] = np.inf
        visited.append(int(np.argmin(away)))
    return visited


def _counts(found: Sequence[Trial]) -> tuple[float, float, float, int, float]:
    """Return shares near, close and published, the number of wrong poses, and the CPU of an image while searching."""
    errors = np.array([walk.meters[WALK - 1] for walk in found])
    published = float(np.mean([walk.is_trusted.any() for walk in found]))
    wrong = sum(int(np.sum(walk.is_trusted & (walk.meters > NEAR_M))) for walk in found)
    ms = float(np.median([np.median(walk.cpu_ms[~walk.is_trusted]) for walk in found]))
    return float(np.mean(errors < NEAR_M)), float(np.mean(errors < CLOSE)), published, wrong, ms


def _bounds(what: str, found: Sequence[Trial]) -> list[Bound]:
    near, _, published, wrong, ms = _counts(found)
    told = Headline("bare geometry", "panoramas in a plan")
    return [
        Bound(f"{what}: within {NEAR_M:g} m after {WALK}", 90.0, 100.0 * near, "%", is_minimum=True),
        Bound(f"{what}: a pose by panorama {PUBLISHED_BY}", 90.0, 100.0 * published, "%", True, told),
        Bound(f"{what}: wrong poses", 0.0, wrong, ""),
        Bound(f"{what}: CPU of an image, searching", MAX_CPU_MS, ms, "ms"),
    ]


def _figures(found: Sequence[Trial]) -> tuple[str, ...]:
    *shares, wrong, ms = _counts(found)
    return (str(len(found)), *(f"{share:.0%}" for share in shares), str(wrong), f"{ms:.0f}")
