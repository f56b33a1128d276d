"""Who is under way, and where at which instant: a function of the stamp and the seed, without memory.

Everybody on a loop goes at the loop's pace, so nobody runs into another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cycab_sim.params import TrafficParams
from cycab_sim.world.mesh import Mesh, joined
from cycab_sim.world.traffic import figures
from cycab_sim.world.traffic.figures import Figure
from cycab_sim.world.traffic.loops import SPACING, Loop, free_loops, standing_place
from cycab_sim.world.worlds import World
from sphere_nav.geometry.arrays import Array, Flags

AWAY = -1000.0  # height of who must not be seen, m
KEEP_OFF = 0.4  # between a car that is in the way of nobody and who comes too close, m
HEADWAY = {"road": 14.0, "cycle": 6.0, "walk": 2.5}  # least way between two who follow each other, m
SPREAD = 0.15  # paces differ by this share from loop to loop


@dataclass(frozen=True)
class Actor:
    """Somebody under way: what is seen, on which loop, from where on it at time 0."""

    figure: Figure
    loop: int
    start: float


class Traffic:
    """Everybody of a seed. `mesh` is all parts, each around its own origin; `poses` says where they are."""

    def __init__(self, world: World, params: TrafficParams, seed: int) -> None:
        if not world.loops:
            raise ValueError("traffic.density: expected a world with streets (town), found one without")
        rng = np.random.default_rng([seed, params.seed, 71])
        self.loops = free_loops(world.loops, world.path, params.may_cross)
        self._paces = np.array(
            [params.speeds[loop.kind] * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD) for loop in self.loops]
        )
        self.actors = _populate(self.loops, params, rng)
        if params.standing_at > 0.0:
            self.loops.append(standing_place(world.path, params.standing_at))
            self._paces = np.append(self._paces, 0.0)
            self.actors.append(Actor(figures.make_pedestrian(rng), len(self.loops) - 1, 0.0))
        parts = [part for actor in self.actors for part in actor.figure.parts]
        if not parts:
            raise ValueError("traffic: expected room for at least one of its members, found none")
        self.mesh: Mesh = joined([part.mesh for part in parts])
        self.part_of_triangle = np.repeat(np.arange(len(parts)), [len(part.mesh.triangles) for part in parts])
        self.part_of_surface = np.repeat(np.arange(len(parts)), [len(part.mesh.frames) for part in parts])
        self._actor_of = np.repeat(np.arange(len(self.actors)), [len(actor.figure.parts) for actor in self.actors])
        owners = [(actor.loop, actor.start, actor.figure.half_width) for actor in self.actors]
        self._loop_of, self._starts, self._widths = (np.array(own)[self._actor_of] for own in zip(*owners, strict=True))
        self._heights = np.array([loop.z for loop in self.loops])[self._loop_of]
        counts = np.array([len(loop.points) for loop in self.loops])
        self._counts, self._firsts = counts[self._loop_of], (np.cumsum(counts) - counts)[self._loop_of]
        self._points = np.concatenate([loop.points for loop in self.loops])
        self._reach = np.array([np.abs(part.mesh.triangles[..., 0]).max() for part in parts], np.float64)  # along x, m
        self._parts = {name: np.array([getattr(part, name) for part in parts], np.float64) for name in _NUMBERS}

    def poses(self, stamp_ns: int, clear: Array | None = None, radius: float = 0.0) -> Array:
        """Return T_world_part (P, 4, 4) at an instant.

        Who comes within `radius` m of one of the points `clear` (N, 2) m is not there at that instant, all his parts.
        """
        way = self._starts + self._paces[self._loop_of] * (stamp_ns * 1e-9)
        middle, half = way + self._parts["ahead"], self._parts["base"] / 2
        front, back = self._on_loops(middle + half), self._on_loops(middle - half)
        ahead = front - back
        yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
        T = np.zeros((len(way), 4, 4))
        p = self._parts
        swing = p["swing"] * np.sin(p["wave"] * way + p["phase"]) + p["roll"] * way
        rotation = _turns(yaw, 0, 1)
        T[:, :3, :3] = rotation @ _turns(swing, 2, 0)
        T[:, :2, 3], T[:, 2, 3], T[:, 3, 3] = (front + back) / 2, self._heights, 1.0
        pivot = self._parts["pivot"][..., None]
        T[:, :3, 3] += (rotation @ pivot - T[:, :3, :3] @ pivot)[..., 0]
        if clear is not None:
            T[self._is_near(T, yaw, clear, radius), 2, 3] = AWAY
        return T

    def _on_loops(self, way: Array) -> Array:
        """Return where parts (P,) are (P, 2) m after their ways (P,) m on their loops."""
        number, share = np.divmod(way / SPACING, 1.0)
        here, there = (self._points[self._firsts + (number + k).astype(int) % self._counts] for k in (0, 1))
        return here + share[:, None] * (there - here)

    def _is_near(self, T: Array, yaw: Array, clear: Array, radius: float) -> Flags:
        """Whether any part of an actor is near one of the points, (P,)."""
        heading = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        off = clear[None] - T[:, None, :2, 3]
        along = (off * heading[:, None]).sum(axis=2)
        outside = along - np.clip(along, -self._reach[:, None], self._reach[:, None])
        aside = off[..., 1] * heading[:, None, 0] - off[..., 0] * heading[:, None, 1]
        near = np.hypot(outside, aside).min(axis=1) < radius + self._widths + KEEP_OFF
        return np.isin(self._actor_of, self._actor_of[near])


_NUMBERS = ("ahead", "base", "pivot", "swing", "wave", "phase", "roll")


def _turns(angles: Array, first: int, second: int) -> Array:
    """Return rotations (P, 3, 3) by angles (P,) that turn one axis towards another one."""
    R = np.tile(np.eye(3), (len(angles), 1, 1))
    R[:, first, first] = R[:, second, second] = np.cos(angles)
    R[:, second, first], R[:, first, second] = np.sin(angles), -np.sin(angles)
    return R


def _populate(loops: Sequence[Loop], params: TrafficParams, rng: np.random.Generator) -> list[Actor]:
    """Return the actors: as many as asked for, or as there is room for, spread over the loops by their length."""
    cars, bicycles, pedestrians = params.members[params.density]
    makers: list[tuple[str, int, Callable[[np.random.Generator], Figure]]] = [
        ("road", cars, figures.make_car),
        ("cycle", bicycles, figures.make_cyclist),
        ("walk", pedestrians, figures.make_pedestrian),
    ]
    actors: list[Actor] = []
    for kind, count, make in makers:
        numbers = [i for i, loop in enumerate(loops) if loop.kind == kind]
        railed = [i for i in numbers if loops[i].has_rails]
        trams = dict(zip(railed, _spread(params.trams, railed, loops), strict=True))
        for i, share in zip(numbers, _spread(count, numbers, loops), strict=True):
            some = [figures.make_tram] * trams.get(i, 0) + [make] * share
            actors += _line_up(i, loops[i], some, rng)
    return actors


def _spread(count: int, numbers: list[int], loops: Sequence[Loop]) -> list[int]:
    """Return how many of `count` go on each loop: the shares of length, rounded so that they add up."""
    if not numbers:
        return []
    ends = np.cumsum([loops[i].length for i in numbers])
    return np.diff(np.rint(np.concatenate([[0.0], count * ends / ends[-1]])).astype(int)).tolist()


def _line_up(
    number: int, loop: Loop, some: list[Callable[[np.random.Generator], Figure]], rng: np.random.Generator
) -> list[Actor]:
    """Return actors on a loop with random gaps between them; those for whom there is no room are left out."""
    made = [make(rng) for make in some]
    while made and sum(2 * f.half_length + HEADWAY[loop.kind] for f in made) > loop.length:
        made.pop()
    made = [made[i] for i in rng.permutation(len(made))]
    free = loop.length - sum(2 * f.half_length + HEADWAY[loop.kind] for f in made)
    gaps = rng.dirichlet(np.full(len(made), 2.0)) * free if made else np.zeros(0)
    actors, here = [], rng.uniform(0.0, loop.length)
    for figure, gap in zip(made, gaps, strict=True):
        actors.append(Actor(figure, number, here + figure.half_length))
        here += 2 * figure.half_length + HEADWAY[loop.kind] + gap
    return actors
