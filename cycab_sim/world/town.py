"""The plan of the town: blocks of houses between streets, drawn from a seed.

Two streets run east and two north; between them lies the centre block, which the taught paths go round. All streets
go on to the edge of the town, where a house across, or trees and far towers, close the view.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cycab_sim.params import SeasonParams
from cycab_sim.world import finishes, furniture
from cycab_sim.world.building import add_house
from cycab_sim.world.mesh import Finish, Mesh, MeshBuilder, Rectangle, flat
from cycab_sim.world.paths import Path, Piece, turn
from cycab_sim.world.street import HALF_ROAD, KERB_HEIGHT, PAVEMENT, add_ground, add_pavement, add_street
from cycab_sim.world.texture import kernels as k

OUTER = 34.0  # depth of the outer blocks, m
LANE = 0.5  # taught paths keep this far to the right of the middle of the street, m
TURN_RADIUS = 5.0
SHIFT = 0.4  # of other cars along the kerb, m
STREETS = "ssss"  # south, north, east and west of a block: a street; or q a square, a an alley, l a lane
TWO_TURNS_LENGTH = 100.0  # M15 section 6.4.3: 100 m with two turns of 90 degrees


@dataclass(frozen=True)
class Plan:
    """Where the streets are: centre lines x = 0 and x = east, y = 0 and y = north."""

    east: float
    north: float

    @property
    def bounds(self) -> Rectangle:
        """Edge of the town."""
        edge = HALF_ROAD + OUTER
        return (-edge, -edge, self.east + edge, self.north + edge)

    def blocks(self) -> list[Rectangle]:
        """Return the nine blocks, kerb to kerb, the centre block first."""
        x0, y0, x1, y1 = self.bounds
        h = HALF_ROAD
        columns = ((h, self.east - h), (x0, -h), (self.east + h, x1))
        rows = ((h, self.north - h), (y0, -h), (self.north + h, y1))
        return [(a, c, b, d) for a, b in columns for c, d in rows]


def draw_plan(seed: int) -> Plan:
    """Return the plan of a seed."""
    rng = np.random.default_rng([seed, 1])
    return Plan(east=float(rng.uniform(40.0, 48.0)), north=float(rng.uniform(32.0, 38.0)))


def taught_path(plan: Plan, name: str) -> Path:
    """Return a path: `two_turns` (M15 fig. 17), `block` (closed, around the centre block) or `straight`."""
    r = TURN_RADIUS
    east, north = plan.east + 2 * LANE - 2 * r, plan.north + 2 * LANE - 2 * r
    corner = plan.east + LANE - r
    left = turn(r, 90)
    if name == "two_turns":
        leg = (TWO_TURNS_LENGTH - north - 2 * left.length) / 2
        return Path((corner - leg, -LANE, 0.0), (Piece(leg), left, Piece(north), left, Piece(leg)))
    if name == "block":
        half = (Piece(east / 2), left, Piece(north), left, Piece(east / 2))
        return Path((corner - east / 2, -LANE, 0.0), half + half, is_closed=True)
    if name == "straight":
        return Path((4.0, -LANE, 0.0), (Piece(30.0),))
    raise ValueError(f"path: expected two_turns, block or straight, found {name!r}")


@lru_cache(maxsize=1)
def build_town(seed: int, season: SeasonParams) -> tuple[Mesh, Plan]:
    """Return the town of a seed: its mesh and its plan."""
    plan = draw_plan(seed)
    mesh = MeshBuilder(np.random.default_rng([seed, 2]), season)
    add_ground(mesh, plan.bounds)
    for block in plan.blocks():
        add_pavement(mesh, block)
        add_houses(mesh, block)
        furnish(mesh, block)
    x0, y0, x1, y1 = plan.bounds
    for y in (0.0, plan.north):
        add_street(mesh.at(x0, y, 0.0), x1 - x0, (-x0, plan.east - x0))
    for x in (0.0, plan.east):
        add_street(mesh.at(x, y0, np.pi / 2), y1 - y0, (-y0, plan.north - y0))
    _close_views(mesh, plan)
    add_skyline(mesh, plan.bounds)
    return mesh.build(), plan


def add_houses(mesh: MeshBuilder, block: Rectangle, sides: str = STREETS) -> None:
    """Line the four sides of a block with houses; the south and north rows take the corners. `sides`: see STREETS."""
    rng = mesh.rng
    south, north, east, west = (0.0 if side == "l" else PAVEMENT for side in sides)
    x0, y0, x1, y1 = (block[0] + west, block[1] + south, block[2] - east, block[3] - north)
    deep = 9.0
    mesh.panels(flat(x0, y0, x1, y1, 0.13), finishes.SOIL)
    for side, length in _sides(mesh, (x0, y0, x1, y1), deep):
        add_row(side, length, deep)
    has_yard = min(x1 - x0, y1 - y0) > 2 * (deep + 2)
    for _ in range(3 if has_yard else 0):
        x, y = rng.uniform(x0 + deep + 2, x1 - deep - 2), rng.uniform(y0 + deep + 2, y1 - deep - 2)
        furniture.add_tree(mesh.at(x, y, rng.uniform(0, 6.28), 0.13))


def _sides(mesh: MeshBuilder, block: Rectangle, corner: float = 0.0) -> list[tuple[MeshBuilder, float]]:
    """Return the south, north, east and west side of a block: x along it, y inwards, and its length, m.

    East and west end `corner` m before the corners of the block.
    """
    x0, y0, x1, y1 = block
    width, depth = x1 - x0, y1 - y0 - 2 * corner
    return [
        (mesh.at(x0, y0, 0.0), width),
        (mesh.at(x1, y1, np.pi), width),
        (mesh.at(x1, y0 + corner, np.pi / 2), depth),
        (mesh.at(x0, y1 - corner, -np.pi / 2), depth),
    ]


def add_row(mesh: MeshBuilder, length: float, deep: float) -> None:
    """Fill a row of `length` m with houses; now and then a gate with a wall and a hedge."""
    rng = mesh.rng
    mesh = mesh.at(0.0, 0.0, 0.0, KERB_HEIGHT)
    x, is_first = 0.0, True
    while length - x > 4.0:
        width = min(rng.uniform(6.5, 12.0), length - x)
        width = length - x if length - x - width < 5.0 else width
        back = rng.uniform(0.0, 0.35)
        if not is_first and width < length - x and rng.random() < 0.14:
            _add_garden(mesh.at(x, back, 0.0), width)
        else:
            add_house(mesh.at(x, back, 0.0), width, deep - back, int(rng.integers(2, 5)))
        x, is_first = x + width, False


def _add_garden(mesh: MeshBuilder, width: float) -> None:
    """Add a garden wall with coping, a hedge behind it and a tree."""
    rng = mesh.rng
    mesh.box([0, 0, 0], [width, 0.3, 1.1], finishes.wall(rng))
    mesh.box([-0.04, -0.06, 1.1], [width + 0.08, 0.42, 0.1], finishes.TRIM)
    leaves = finishes.foliage(rng)
    for x in np.arange(0.8, width - 0.4, 0.9):
        furniture.add_lump(mesh, np.array([x, 1.0, 1.1]), rng.uniform(0.6, 0.85), leaves)
    furniture.add_tree(mesh.at(width / 2, 4.0, 0.0))


def furnish(mesh: MeshBuilder, block: Rectangle, sides: str = STREETS) -> None:
    """Put cars along the kerbs of a block and lamps, signs, trees, boxes and benches on its pavement."""
    rng = mesh.rng
    day = np.random.default_rng([mesh.season.parked, int(rng.spawn(1)[0].integers(1 << 30))])
    for (kerb, length), side in zip(_sides(mesh, block), sides, strict=True):
        if side in "al":
            continue
        x = rng.uniform(6.0, 9.0)
        while x < length - 7.5 and side == "s":  # x along the kerb, y < 0 is the road
            _park(kerb.unseen() if mesh.season.parked else kerb, x)
            if mesh.season.parked:
                _park(kerb.drawn_by(day), x + day.uniform(-SHIFT, SHIFT))
            x += rng.uniform(5.3, 7.5)
        for x in np.arange(rng.uniform(1.5, 4.0), length - 1.0, 4.5):
            add_on_pavement(kerb.at(x + rng.uniform(-1.0, 1.0), 0.0, 0.0, KERB_HEIGHT))


def _park(kerb: MeshBuilder, x: float) -> None:
    """Put a car, or none, on the road beside a kerb, x m along it."""
    rng = kerb.rng
    if rng.random() < 0.55:
        flip = np.pi if rng.random() < 0.3 else 0.0
        furniture.add_car(kerb.clutter().at(x, -1.05, flip + rng.normal(0.0, 0.02)))


def add_on_pavement(mesh: MeshBuilder) -> None:
    """Put one thing on the pavement: by the kerb (x along it, y away from the road) or by the wall."""
    rng = mesh.rng
    kind = rng.random()
    if kind < 0.22:
        furniture.add_lamp(mesh.at(0.0, 0.35, -np.pi / 2))
    elif kind < 0.40:
        furniture.add_traffic_sign(mesh.at(0.0, 0.4, rng.normal(0.0, 0.1)))
    elif kind < 0.55:
        furniture.add_tree(mesh.at(0.0, 0.75, rng.uniform(0, 6.28)))
    elif kind < 0.70:
        furniture.add_box(mesh.clutter().at(0.0, PAVEMENT - 0.65, -np.pi / 2))
    elif kind < 0.80:
        furniture.add_bench(mesh.at(0.0, PAVEMENT - 0.4, -np.pi / 2))
    else:
        for x in (0.0, 1.4, 2.8)[: int(rng.integers(1, 4))]:
            furniture.add_bollard(mesh.at(x, 0.3, 0.0))


def street_ends(
    mesh: MeshBuilder,
    bounds: Rectangle,
    off: float,
    across: tuple[float, ...],
    north: tuple[float, ...],
    south: tuple[float, ...],
) -> list[MeshBuilder]:
    """Return places `off` m beyond the bounds of a town at the ends of its streets, x to the right, y outwards.

    Streets run along x at y = `across`, and along y, to the `north` and to the `south`, at these x, m.
    """
    x0, y0, x1, y1 = bounds
    east_west = [(x, y, yaw) for x, yaw in ((x1 + off, -np.pi / 2), (x0 - off, np.pi / 2)) for y in across]
    ends = [*east_west, *((x, y1 + off, 0.0) for x in north), *((x, y0 - off, np.pi) for x in south)]
    return [mesh.at(*end) for end in ends]


def _close_views(mesh: MeshBuilder, plan: Plan) -> None:
    """Close most street ends by a house across, the others by two rows of trees."""
    rng = mesh.rng
    across, along = (0.0, plan.north), (0.0, plan.east)
    for end in street_ends(mesh, plan.bounds, 9.0, across, along, along):
        if rng.random() < 0.6:
            add_house(end.at(-9.0, 0.0), 18.0, 8.0, int(rng.integers(3, 6)))
        else:
            for x, y in ((-5, 0), (5, 0), (-5, 8), (5, 8), (-6, 17), (6, 17), (0, 26)):
                furniture.add_tree(end.at(x + rng.normal(0, 0.5), y, rng.uniform(0, 6)))


def add_skyline(mesh: MeshBuilder, bounds: Rectangle) -> None:
    """Add towers all around, 40 to 140 m beyond the edge."""
    rng = mesh.rng
    x0, y0, x1, y1 = bounds
    for angle in np.linspace(0.0, 2 * np.pi, 28, endpoint=False) + rng.uniform(0, 0.2, 28):
        far = rng.uniform(40.0, 140.0)
        x = (x0 + x1) / 2 + np.cos(angle) * ((x1 - x0) / 2 * 1.3 + far)
        y = (y0 + y1) / 2 + np.sin(angle) * ((y1 - y0) / 2 * 1.3 + far)
        w, d, height = rng.uniform(12, 26), rng.uniform(10, 18), rng.uniform(12, 38)
        color = finishes.pick(rng, finishes.PLASTERS)
        front = Finish(k.FACADE, color, (0.10, 0.11, 0.12), (0.12, rng.uniform(2.2, 3.5), rng.uniform(2.8, 3.4)))
        mesh.at(x, y, angle + rng.normal(0, 0.3)).box([-w / 2, -d / 2, 0.0], [w, d, height], front)
