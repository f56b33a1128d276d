"""Ways along streets, and a street along any path: houses, trees, cars and what stands on pavements."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from cycab_sim.world import finishes, furniture
from cycab_sim.world.building import add_house
from cycab_sim.world.mesh import Mesh, MeshBuilder, Rectangle, placed
from cycab_sim.world.paths import Path, Piece, turn
from cycab_sim.world.street import HALF_ROAD, KERB_HEIGHT, PAVEMENT, add_ground
from cycab_sim.world.town import add_on_pavement, add_skyline
from sphere_nav.geometry.arrays import Array

BEYOND = 60.0  # of the road before its beginning and behind its end, m
SLAB, DEEP, NEXT = 4.0, 9.0, 5.0  # of a piece of pavement, of a house, from thing to thing on the pavement, m
WALL = HALF_ROAD + PAVEMENT  # from the middle, m


def rounded_way(corners: ArrayLike, radius: float = 6.0) -> Path:
    """Return the way along an open polygon (K, 2) m whose inner corners are arcs, as far as its legs allow."""
    points = np.asarray(corners, dtype=np.float64)
    legs = np.diff(points, axis=0)
    lengths, heads = np.hypot(*legs.T), np.arctan2(legs[:, 1], legs[:, 0])
    turns = (np.diff(heads) + np.pi) % (2 * np.pi) - np.pi
    radii = np.minimum(radius, np.minimum(lengths[:-1], lengths[1:]) / 2)
    cuts = np.concatenate([[0.0], radii * np.tan(np.abs(turns) / 2), [0.0]])
    pieces: list[Piece] = []
    for number, length in enumerate(lengths):
        pieces.append(Piece(float(length - cuts[number] - cuts[number + 1])))
        if number < len(turns):
            pieces.append(turn(float(radii[number]), float(np.degrees(turns[number]))))
    return Path((*points[0].tolist(), float(heads[0])), tuple(pieces))


def place_beside(path: Path, along: float, left: float, yaw: float = 0.0, height: float = 0.0) -> Array:
    """Return the placement (4, 4) `along` m on a path, `left` m beside it, turned by `yaw` rad, `height` m up."""
    x, y, heading, _ = path.at(along).tolist()
    return placed(x - left * np.sin(heading), y + left * np.cos(heading), heading + yaw, height)


@lru_cache(maxsize=1)
def build_road(seed: int, middle: Path, bounds: Rectangle) -> Mesh:
    """Return the street of a seed along its middle."""
    mesh = MeshBuilder(np.random.default_rng([seed, 65]))
    add_ground(mesh, bounds)
    for side in (1.0, -1.0):  # left, right
        _add_pavement(mesh, middle, side)
        _add_houses(mesh, middle, side)
        _furnish(mesh, middle, side)
    add_skyline(mesh, bounds)
    return mesh.build()


def _add_pavement(mesh: MeshBuilder, middle: Path, side: float) -> None:
    for begin in np.arange(-BEYOND, middle.length + BEYOND, SLAB):
        ways = [(s, off) for s, off in ((begin, HALF_ROAD), (begin + SLAB, HALF_ROAD))]
        ways += [(s, WALL) for s, _ in reversed(ways)]
        quad = np.array([place_beside(middle, s, side * off, height=KERB_HEIGHT)[:3, 3] for s, off in ways])
        mesh.panels([quad if side > 0 else quad[::-1]], finishes.PAVING)


def _add_houses(mesh: MeshBuilder, middle: Path, side: float) -> None:
    s, rng = -BEYOND, mesh.rng
    while s < middle.length + BEYOND:
        width, back = rng.uniform(6.5, 10.0), rng.uniform(0.1, 0.5)
        bend = float(middle.at(s)[3]) if 0.0 <= s <= middle.length else 0.0
        way = width / (1.0 - bend * side * WALL)  # along the middle
        corner, yaw = (s, 0.5 * bend * way) if side > 0 else (s + way, np.pi - 0.5 * bend * way)
        at = place_beside(middle, corner, side * (WALL + back), yaw, KERB_HEIGHT)
        add_house(mesh.within(at), width, DEEP, int(rng.integers(2, 5)))
        s += way + (rng.uniform(2.0, 5.0) if rng.random() < 0.2 else 0.0)


def _furnish(mesh: MeshBuilder, middle: Path, side: float) -> None:
    yaw, rng = 0.0 if side > 0 else np.pi, mesh.rng
    for s in np.arange(-BEYOND + rng.uniform(0.0, NEXT), middle.length + BEYOND, NEXT):
        add_on_pavement(mesh.within(place_beside(middle, s, side * HALF_ROAD, yaw, KERB_HEIGHT)))
        if side > 0 and rng.random() < 0.4:
            kerb = mesh.clutter().within(place_beside(middle, s, HALF_ROAD, yaw))
            furniture.add_car(kerb.at(0.0, -1.05))
