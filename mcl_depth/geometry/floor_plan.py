"""A floor plan as a map: rooms of walls with heights, doors and openings cut out.

The file is a table with the columns kind, complete_room, x0_m, y0_m, x1_m, y1_m, z_bottom_m, z_top_m; lines that
begin with # are remarks. The walls of a room that form a closed ring get a floor and a ceiling.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_OFF_WALL, MAX_SURFACES, MIN_PIECE, SAME_CORNER
from mcl_depth.geometry.cloud import Geometry
from mcl_depth.geometry.mesh import mesh_from_faces
from sphere_nav.geometry.files.untrusted import number, read_text, short

KINDS = ("wall", "door", "window", "opening")
CUT = ("door", "opening")  # windows stay: what is behind them is not in the plan
NUMBERS = ("x0_m", "y0_m", "x1_m", "y1_m", "z_bottom_m", "z_top_m")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class WallSurface:
    """An upright rectangle: foot from start to end (2,) in m, between two heights."""

    kind: str
    room: str
    start: Floats
    end: Floats
    bottom: float
    top: float


def read_floor_plan(path: Path) -> Geometry:
    """Read a floor plan as a mesh."""
    return mesh_of(list(read_surfaces(path)), str(path))


def mesh_of(surfaces: list[WallSurface], name: str) -> Geometry:
    """Return the mesh of a floor plan's surfaces; ValueError without a wall."""
    triangles = [corners for room in dict.fromkeys(item.room for item in surfaces) for corners in _room(surfaces, room)]
    if not triangles:
        raise ValueError(f"{name}: expected at least one wall, found none")
    vertices = np.concatenate(triangles)
    return mesh_from_faces(vertices, np.arange(len(vertices)).reshape(-1, 3), name)


def read_surfaces(path: Path) -> Iterator[WallSurface]:
    """Yield the surfaces of a table; ValueError in one line."""
    lines = read_text(path, "floor plan", errors="replace").split("\n")
    table = csv.DictReader(line for line in lines if not line.startswith("#"))
    try:
        if missing := [name for name in ("kind", "complete_room", *NUMBERS) if name not in (table.fieldnames or ())]:
            raise ValueError(f"{path}: columns: expected {', '.join(missing)}, found {short(table.fieldnames)}")
        for count, row in enumerate(table, start=1):
            if count > MAX_SURFACES:
                raise ValueError(f"{path}: expected at most {MAX_SURFACES} surfaces, found more")
            yield _surface(f"{path}: surface {count}", row)
    except csv.Error as error:
        raise ValueError(f"{path}: expected a table, found {error}") from None


def _surface(where: str, row: dict[str, str]) -> WallSurface:
    if row["kind"] not in KINDS:
        raise ValueError(f"{where}: kind: expected one of {', '.join(KINDS)}, found {short(row['kind'])}")
    x0, y0, x1, y1, bottom, top = (number(row[name], f"{where}: {name}") for name in NUMBERS)
    if top < bottom:
        raise ValueError(f"{where}: expected z_top above z_bottom, found {bottom:g} to {top:g}")
    return WallSurface(row["kind"], row["complete_room"] or "", np.array([x0, y0]), np.array([x1, y1]), bottom, top)


def _room(surfaces: list[WallSurface], room: str) -> Iterator[Floats]:
    """Yield triangles (3, 3) of the walls, the floors and the ceilings of a room."""
    own = [item for item in surfaces if item.room == room]
    walls = [item for item in own if item.kind == "wall"]
    holes = [item for item in own if item.kind in CUT]
    for wall in walls:
        yield from _wall(wall, holes)
    for ring in rings_of(walls):
        for triangle in _triangles(ring):
            for z in (min(wall.bottom for wall in walls), max(wall.top for wall in walls)):
                yield np.column_stack([triangle, np.full(3, z)])


def _wall(wall: WallSurface, holes: list[WallSurface]) -> Iterator[Floats]:
    """Yield the triangles of a wall without its holes, as a grid of rectangles between all their edges."""
    length = float(np.linalg.norm(wall.end - wall.start))
    if length < MIN_PIECE:
        return
    along = (wall.end - wall.start) / length
    cuts = [cut for hole in holes if (cut := _cut(wall, along, length, hole)) is not None]
    places = sorted({0.0, length, *(edge for cut in cuts for edge in cut[:2])})
    heights = sorted({wall.bottom, wall.top, *(edge for cut in cuts for edge in cut[2:])})
    for s0, s1 in pairwise(places):
        for z0, z1 in pairwise(heights):
            s, z = (s0 + s1) / 2, (z0 + z1) / 2
            if not any(cut[0] < s < cut[1] and cut[2] < z < cut[3] for cut in cuts):
                a, b = wall.start + s0 * along, wall.start + s1 * along
                yield np.array([(*a, z0), (*b, z0), (*b, z1)])
                yield np.array([(*a, z0), (*b, z1), (*a, z1)])


def _cut(
    wall: WallSurface, along: Floats, length: float, hole: WallSurface
) -> tuple[float, float, float, float] | None:
    """Return where (from, to, bottom, top) a hole cuts a wall, None where it belongs to another one."""
    across = np.array([-along[1], along[0]])
    ends = np.stack([hole.start, hole.end]) - wall.start
    if np.abs(ends @ across).max() > MAX_OFF_WALL:
        return None
    first, last = np.clip(np.sort(ends @ along), 0.0, length)
    bottom = wall.bottom if hole.bottom - wall.bottom < SAME_CORNER else hole.bottom
    top = min(hole.top, wall.top)
    return (float(first), float(last), bottom, top) if last - first > MIN_PIECE and top > bottom else None


def rings_of(walls: list[WallSurface]) -> list[Floats]:
    """Return the closed rings (N, 2) that consecutive walls form."""
    rings, open_ring = [], list[WallSurface]()
    for wall in walls:
        if open_ring and np.abs(open_ring[-1].end - wall.start).max() > SAME_CORNER:
            open_ring = []
        open_ring.append(wall)
        if len(open_ring) > 2 and np.abs(wall.end - open_ring[0].start).max() <= SAME_CORNER:
            rings.append(np.stack([item.start for item in open_ring]))
            open_ring = []
    return rings


def _triangles(ring: Floats) -> Iterator[Floats]:
    """Yield triangles (3, 2) that cover a polygon (N, 2): trapezoids between the heights of its corners, cut in two."""
    ends = np.roll(ring, -1, axis=0)
    for low, high in pairwise(np.unique(ring[:, 1])):
        is_between = (np.minimum(ring, ends)[:, 1] <= low) & (np.maximum(ring, ends)[:, 1] >= high)
        start, side = ring[is_between], (ends - ring)[is_between]
        x = start[:, :1] + ([low, high] - start[:, 1:]) / side[:, 1:] * side[:, :1]  # of each side at both heights
        x = x[np.argsort(x.sum(axis=1))]
        for (left, above_left), (right, above_right) in zip(x[::2], x[1::2], strict=True):
            if right > left:
                yield np.array([(left, low), (right, low), (above_right, high)])
            if above_right > above_left:
                yield np.array([(left, low), (above_right, high), (above_left, high)])
