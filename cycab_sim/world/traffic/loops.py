"""Where traffic goes: closed loops along streets and pavements, none of them in the way unless that is asked for.

A loop leaves the town where nobody sees it, behind the outer blocks, so nothing appears or vanishes in view.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from cycab_sim.world import city
from cycab_sim.world.mesh import Rectangle
from cycab_sim.world.paths import Path, rounded
from cycab_sim.world.street import HALF_ROAD, KERB_HEIGHT
from cycab_sim.world.town import Plan
from sphere_nav.geometry.arrays import Array

SPACING = 0.25  # m between the points of a loop
WIDTHS = {"road": 2.5, "cycle": 0.7, "walk": 0.7}  # of what moves on a loop, m
CLEAR = 1.0  # from the middle of the taught path: half a car and some air, m
NEAR, FAR = 3.4, 6.6  # of the roads around the town, outside of its edge, m
ASIDE = 0.45  # of the road on the street that cyclists share, m
WALK = 1.1  # from the kerb: between what stands beside it and beside the walls, m


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed way (N, 2) m with a point each SPACING m, all at height z m, for one kind of traffic.

    A loop that is crossing leads over the street between other loops: those on it may run into others. Trams keep to
    loops with rails.
    """

    kind: str
    points: Array
    z: float = 0.0
    is_crossing: bool = False
    has_rails: bool = False

    @property
    def length(self) -> float:
        """Length in metres, as those who move on it count it."""
        return len(self.points) * SPACING


def town_loops(plan: Plan) -> tuple[Loop, ...]:
    """Return all loops of a town: streets and the road around it, cycling around the centre, walks on pavements."""
    x0, y0, x1, y1 = plan.bounds
    e, n = plan.east, plan.north
    roads = [
        _upwards((-ASIDE, y0 - NEAR, x0 - NEAR, y1 + NEAR)),
        _upwards(plan.bounds, -FAR),
        _inset((e, y1 + NEAR, x1 + NEAR, y0 - NEAR)),
    ]
    a, b = 1.1, 1.3  # to the right of the middle of the street
    cycles = [_upwards((b, a, e - a, n - a))]
    walks = [_inset(block, WALK)[:: 1 if i % 2 else -1] for i, block in enumerate(plan.blocks())]
    zebra, over = HALF_ROAD + 2.1, HALF_ROAD + 1.0
    across = [_inset((zebra, y - over, e - zebra, y + over)) for y in (0.0, n)]
    across += [_inset((x - over, zebra, x + over, n - zebra)) for x in (0.0, e)]
    return (
        *_loops("road", roads[:1], 6.0, has_rails=True),
        *_loops("road", roads[1:], 6.0),
        *_loops("cycle", cycles, 3.4),
        *_loops("walk", walks, 0.8, KERB_HEIGHT),
        *_loops("walk", across, 0.8, KERB_HEIGHT, is_crossing=True),
    )


def city_loops() -> tuple[Loop, ...]:
    """Return all loops of the city: lanes against the tour, the tram's way, the road around, cycles, walks."""
    block = (-20.0, 0.0, 40.0, 110.0)  # between the middles of streets C, A, F and B
    a, b = 1.6, 3.2  # from the middle of the street: cars, cyclists
    roads = [_upwards(block, a), _upwards(city.BOUNDS, -FAR), _inset(block, -a)]
    cycles = [_upwards((126.0, 8.0, 163.0, 46.0))]  # on the square
    along = [_upwards(block, b)]
    blocks = [area for area, sides in city.BLOCKS if "l" not in sides]
    areas = [*((area, WALK) for area in blocks), ((80.0, 10.0, 111.0, 44.0), 0.0), ((78.0, -38.0, 140.0, -12.0), 0.0),
             ((130.0, 12.0, 158.0, 40.0), 0.0), ((60.0, -12.0, 80.0, 12.0), 0.0)]  # fmt: skip
    walks = [_inset(area, d)[:: 1 if i % 2 else -1] for i, (area, d) in enumerate(areas)]
    return (
        *_loops("road", roads, 6.0),
        *_loops("road", [list(city.TRAM)], city.TRAM_RADIUS, has_rails=True),
        *_loops("cycle", along, 6.0 - (b - a)),
        *_loops("cycle", cycles, 4.0),
        *_loops("walk", walks[: len(blocks)], 0.8, KERB_HEIGHT),
        *_loops("walk", walks[len(blocks) :], 2.0),
    )


def free_loops(loops: Iterable[Loop], path: Path, may_cross: bool) -> list[Loop]:
    """Return the loops on which nothing comes into the way of a car on the path; all of them if they may cross it."""
    taught = path.at(np.arange(0.0, path.length + 6.0, 0.5))[:, :2]

    def is_free(loop: Loop) -> bool:
        return bool(cdist(loop.points[::2], taught).min() > CLEAR + WIDTHS[loop.kind] / 2)

    return [loop for loop in loops if may_cross or (not loop.is_crossing and is_free(loop))]


def standing_place(path: Path, distance: float) -> Loop:
    """Return the walk of who does not walk: a point of a path, at a distance from its start in m."""
    return Loop("walk", np.tile(path.at(distance)[:2], (2, 1)))


def _loops(
    kind: str, corners: list[list[tuple[float, float]]], radius: float, z: float = 0.0, **more: bool
) -> list[Loop]:
    paths = [rounded(np.array(some), radius) for some in corners]
    counts = [round(path.length / SPACING) for path in paths]
    return [Loop(kind, p.at(np.arange(c) * p.length / c)[:, :2], z, **more) for p, c in zip(paths, counts, strict=True)]


def _inset(block: Rectangle, d: float = 0.0) -> list[tuple[float, float]]:
    """Return the corners of a rectangle, `d` m inside, from the first one along x."""
    x0, y0, x1, y1 = block
    return [(x0 + d, y0 + d), (x1 - d, y0 + d), (x1 - d, y1 - d), (x0 + d, y1 - d)]


def _upwards(block: Rectangle, d: float = 0.0) -> list[tuple[float, float]]:
    """Return the corners of a rectangle, `d` m inside, from the first one along y."""
    first, *others = _inset(block, d)
    return [first, *reversed(others)]
