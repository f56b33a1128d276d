"""A road of 1 km in wide bends, for the speed of traffic (M15 6.3.4), and a square open for 60 m around (M15 6.4.5)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cycab_sim.world import finishes, furniture
from cycab_sim.world.building import add_house
from cycab_sim.world.city import BAND, FLAGS
from cycab_sim.world.mesh import Mesh, MeshBuilder, placed
from cycab_sim.world.paths import Path, Piece, turn
from cycab_sim.world.street import HALF_ROAD, KERB_HEIGHT, PAVEMENT, add_ground
from cycab_sim.world.town import Rectangle, add_on_pavement, add_row, add_skyline
from sphere_nav.geometry.arrays import Array

BENDS = ((150.0, 120.0, 45.0), (110.0, 80.0, -60.0), (140.0, 100.0, 50.0))  # a straight m, then radius m and turn deg
LAST = 334.7  # straight behind them: the road has 1 km, m
LANE = 1.75  # of the car, to the right of the middle, m
BEYOND = 60.0  # of the road before its beginning and behind its end, m
SLAB, DEEP, NEXT = 4.0, 9.0, 5.0  # of a piece of pavement, of a house, from thing to thing on the pavement, m
WALL = HALF_ROAD + PAVEMENT  # from the middle, m
ROAD_BOUNDS: Rectangle = (-90.0, -60.0, 970.0, 420.0)
SQUARE: Rectangle = (-105.0, -85.0, 105.0, 85.0)
LAMPS = ((-6.0, 3.0), (10.0, -12.0), (22.0, 14.0), (34.0, -4.0))  # beside the way over the square, m


def road_path(left: float = -LANE) -> Path:
    """Return the way along the road, `left` m beside its middle."""
    pieces: list[Piece] = []
    for straight, radius, degrees in BENDS:
        pieces += [Piece(straight), turn(radius - float(np.sign(degrees)) * left, degrees)]
    return Path((0.0, left, 0.0), (*pieces, Piece(LAST)))


def square_path() -> Path:
    """Return the way over the square: an S of 60 m, further than 60 m from every house."""
    return Path((-16.0, -8.0, 0.0), (Piece(12.0), turn(12.0, 60.0), Piece(6.0), turn(12.0, -60.0), Piece(16.87)))


def place_beside(path: Path, along: float, left: float, yaw: float = 0.0, height: float = 0.0) -> Array:
    """Return the placement (4, 4) `along` m on a path, `left` m beside it, turned by `yaw` rad, `height` m up."""
    x, y, heading, _ = path.at(along).tolist()
    return placed(x - left * np.sin(heading), y + left * np.cos(heading), heading + yaw, height)


@lru_cache(maxsize=1)
def build_road(seed: int, path: Path | None = None, bounds: Rectangle = ROAD_BOUNDS) -> Mesh:
    """Return a road of a seed: houses, trees, cars and what stands on pavements along both kerbs.

    `path`: its middle, where it is not the road of 1 km.
    """
    rng = np.random.default_rng([seed, 65])
    mesh = MeshBuilder(rng)
    add_ground(mesh, bounds)
    middle = path or road_path(0.0)
    for side in (1.0, -1.0):  # left, right
        _add_pavement(mesh, middle, side)
        _add_houses(mesh, middle, side, rng)
        _furnish(mesh, middle, side, rng)
    add_skyline(mesh, bounds, rng)
    return mesh.build()


def _add_pavement(mesh: MeshBuilder, middle: Path, side: float) -> None:
    for begin in np.arange(-BEYOND, middle.length + BEYOND, SLAB):
        ways = [(s, off) for s, off in ((begin, HALF_ROAD), (begin + SLAB, HALF_ROAD))]
        ways += [(s, WALL) for s, _ in reversed(ways)]
        quad = np.array([place_beside(middle, s, side * off, height=KERB_HEIGHT)[:3, 3] for s, off in ways])
        mesh.panels([quad if side > 0 else quad[::-1]], finishes.PAVING)


def _add_houses(mesh: MeshBuilder, middle: Path, side: float, rng: np.random.Generator) -> None:
    s = -BEYOND
    while s < middle.length + BEYOND:
        width, back = rng.uniform(6.5, 10.0), rng.uniform(0.1, 0.5)
        bend = float(middle.at(s)[3]) if 0.0 <= s <= middle.length else 0.0
        way = width / (1.0 - bend * side * WALL)  # along the middle
        corner, yaw = (s, 0.5 * bend * way) if side > 0 else (s + way, np.pi - 0.5 * bend * way)
        at = place_beside(middle, corner, side * (WALL + back), yaw, KERB_HEIGHT)
        add_house(mesh, at, width, DEEP, int(rng.integers(2, 5)), rng)
        s += way + (rng.uniform(2.0, 5.0) if rng.random() < 0.2 else 0.0)


def _furnish(mesh: MeshBuilder, middle: Path, side: float, rng: np.random.Generator) -> None:
    yaw = 0.0 if side > 0 else np.pi
    for s in np.arange(-BEYOND + rng.uniform(0.0, NEXT), middle.length + BEYOND, NEXT):
        add_on_pavement(mesh, place_beside(middle, s, side * HALF_ROAD, yaw, KERB_HEIGHT), rng)
        if side > 0 and rng.random() < 0.4:
            mesh.is_clutter = mesh.is_parked = True
            furniture.add_car(mesh, place_beside(middle, s, HALF_ROAD, yaw) @ placed(0.0, -1.05, 0.0), rng)
            mesh.is_clutter = mesh.is_parked = False


@lru_cache(maxsize=1)
def build_square(seed: int) -> Mesh:
    """Return the square of a seed: flags, a few lamps whose shadows cross the way, trees and houses far around."""
    rng = np.random.default_rng([seed, 66])
    mesh = MeshBuilder(rng)
    x0, y0, x1, y1 = SQUARE
    add_ground(mesh, (x0 - 20.0, y0 - 20.0, x1 + 20.0, y1 + 20.0))
    mesh.panels([[[x0, y0, 0.008], [x1, y0, 0.008], [x1, y1, 0.008], [x0, y1, 0.008]]], FLAGS)
    for y in np.arange(y0 + 10.0, y1 - 5.0, 10.0):
        a, b = x0 + 8.0, x1 - 8.0
        mesh.panels([[[a, y, 0.011], [b, y, 0.011], [b, y + 0.6, 0.011], [a, y + 0.6, 0.011]]], BAND)
    for corner, length in (
        (placed(x1, y0, np.pi), x1 - x0),
        (placed(x0, y1, 0.0), x1 - x0),
        (placed(x1, y1, -np.pi / 2), y1 - y0),
        (placed(x0, y0, np.pi / 2), y1 - y0),
    ):
        add_row(mesh, corner @ placed(0.0, 0.0, 0.0, -KERB_HEIGHT), length, DEEP, rng)
        for x in np.arange(8.0, length - 8.0, 9.0):
            furniture.add_tree(mesh, corner @ placed(x, -6.0, rng.uniform(0.0, 6.28)), rng)
    for x, y in LAMPS:
        furniture.add_lamp(mesh, placed(x, y, rng.uniform(0.0, 6.28)), rng)
    add_skyline(mesh, SQUARE, rng)
    return mesh.build()
