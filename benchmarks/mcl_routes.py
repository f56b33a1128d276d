"""Ways through the simulator's worlds: planar poses of the vehicle at equal distances."""

from __future__ import annotations

import numpy as np

from cycab_sim.world.paths import Path, Piece, turn
from cycab_sim.world.town import Plan
from sphere_nav.geometry.arrays import Array

RADIUS = 5.0  # of the bends, m
SIDE = 100.0  # of the part of the town that is considered, m
MAX_OFFSET = 1.3  # to the right or left of the middle of the street, m; cars are parked further out
MARGIN = 2.0  # from the edge of that part, m


def limits(plan: Plan) -> tuple[float, float, float, float]:
    """Return x0, y0, x1, y1 of a square of 100 x 100 m around the middle of the town."""
    x, y, half = plan.east / 2, plan.north / 2, SIDE / 2
    return x - half, y - half, x + half, y + half


def kidnapped_line(plan: Plan, count: int, step: float, rng: np.random.Generator) -> Array:
    """Return poses (count, 3) from anywhere in the streets onwards; at a crossing by lot left, right or straight on."""
    x0, y0, x1, y1 = limits(plan)
    while True:
        poses = _drawn(plan, rng).at(np.arange(count) * step)[:, :3]
        inside = (poses[:, 0] > x0 + MARGIN) & (poses[:, 0] < x1 - MARGIN)
        if np.all(inside & (poses[:, 1] > y0 + MARGIN) & (poses[:, 1] < y1 - MARGIN)):
            return poses


def sampled(path: Path, step: float, count: int | None = None) -> Array:
    """Return poses (K, 3) along a path; round again where more are wanted than it is long."""
    number = count if count is not None else int(path.length / step) + 1
    return path.at(np.arange(number) * step)[:, :3]


def _drawn(plan: Plan, rng: np.random.Generator) -> Path:
    """Return a way along a street, around the next corner or past it; outside of the town where it was badly drawn."""
    is_along_x, is_upwards = rng.random() < 0.5, rng.random() < 0.5
    across = (0.0, plan.north) if is_along_x else (0.0, plan.east)  # the streets of this direction
    ahead = (0.0, plan.east) if is_along_x else (0.0, plan.north)  # where streets cross them
    yaw = (0.0 if is_upwards else np.pi) if is_along_x else (np.pi / 2 if is_upwards else -np.pi / 2)
    street, begin, right = across[int(rng.integers(2))], rng.uniform(-50.0, 90.0), rng.uniform(-MAX_OFFSET, MAX_OFFSET)
    middle = np.array([begin, street]) if is_along_x else np.array([street, begin])
    start = middle + right * np.array([np.sin(yaw), -np.cos(yaw)])
    sign = 1.0 if is_upwards else -1.0
    ways = [sign * (crossing - begin) for crossing in ahead if sign * (crossing - begin) > RADIUS + MAX_OFFSET]
    choice = int(rng.integers(3))
    pieces: tuple[Piece, ...] = (Piece(1.0),)
    if ways and choice:
        side = 1.0 if choice == 1 else -1.0  # left, right
        pieces = (Piece(min(ways) + side * right - RADIUS), turn(RADIUS, side * 90.0), Piece(1.0))
    return Path((float(start[0]), float(start[1]), float(yaw)), pieces)
