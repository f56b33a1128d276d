"""The quickest way over a network, by Dijkstra over edges and the direction in which each is driven, and its path.

States are directed edges, not nodes, so that a change of direction (a cusp) has its cost, and so that a round can end
on the edge that it began on.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

import numpy as np

from path_follower.constants import MAX_POINTS
from path_follower.routes.constants import AT_PLACE, CUSP_COST, REVERSE_COST
from path_follower.routes.network import Network, RouteEdge, Spot
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True)
class Leg:
    """A part of an edge, from `first` to `last` m of it; `direction` -1: backwards, `first` is the larger one."""

    edge: int
    direction: int
    first: float
    last: float

    @property
    def length(self) -> float:
        """Way in m."""
        return abs(self.last - self.first)

    @property
    def name(self) -> str:
        """The edge's number, with a minus where it is driven backwards."""
        return f"{'-' if self.direction < 0 else ''}{self.edge}"


@dataclass(frozen=True)
class Route:
    """Legs in order of driving, and s that they take at the cruise speed; each round at the end has `round_legs`."""

    legs: tuple[Leg, ...]
    seconds: float = 0.0
    round_legs: int = 0

    @cached_property
    def ends(self) -> Array:
        """Where legs end (K,), m from the vehicle."""
        return np.cumsum([leg.length for leg in self.legs])

    @property
    def length(self) -> float:
        """Way in m."""
        return float(self.ends[-1]) if self.legs else 0.0

    def leg_at(self, way: float) -> int:
        """Return which leg a vehicle is on that has driven this far."""
        return min(int(np.searchsorted(self.ends, way, side="right")), len(self.legs) - 1)


def plan(
    network: Network,
    starts: Sequence[Spot],
    goals: Sequence[Spot],
    *,
    cruise: float,
    closed: Collection[int] = (),
    is_round: bool = False,
) -> Route:
    """Return the quickest way from one of the starts to one of the goals; ValueError where there is none.

    `is_round`: to where it starts, once around. Edges that are closed are not driven; a vehicle that stands on one may
    leave it backwards, where that is allowed.
    """
    queue: list[tuple[float, int, bool, tuple[Leg, ...]]] = []  # cost, number, whether a goal is reached, legs
    numbers = count()

    def add(cost: float, *legs: Leg) -> None:
        """Add legs, and them up to each goal on the last one; one just behind the start is reached, but by no round."""
        *before, leg = legs
        pace = network.edges[leg.edge].pace(cruise) * (1.0 if leg.direction > 0 else REVERSE_COST)
        heapq.heappush(queue, (cost + pace * leg.length, next(numbers), False, legs))
        for part in _reaching(leg, goals, 0.0 if before else AT_PLACE if is_round else -AT_PLACE):
            heapq.heappush(queue, (cost + pace * part.length, next(numbers), True, (*before, part)))

    for leg in _first(network, starts, closed):
        add(0.0, leg)
    ways = _open_ways(network, closed)
    done: set[tuple[int, int, bool]] = set()
    while queue:
        cost, _, is_end, legs = heapq.heappop(queue)
        if is_end:
            return Route(legs, sum(network.edges[leg.edge].pace(cruise) * leg.length for leg in legs))
        leg = legs[-1]
        key = leg.edge, leg.direction, len(legs) == 1  # a part of an edge stands for no whole one
        if key in done:
            continue
        done.add(key)
        for following in ways[network.edges[leg.edge].ends(leg.direction)[1]]:
            add(cost + CUSP_COST * (following.direction != leg.direction), *legs, following)
    named = f" while {', '.join(map(str, sorted(closed)))} are closed" if closed else ""
    raise ValueError(f"no way: no edges lead there from here{named}")


def _first(network: Network, starts: Sequence[Spot], closed: Collection[int]) -> list[Leg]:
    """Return the legs on which it may begin; ValueError where there is none."""
    if not starts:
        raise ValueError("no way: expected a start on the network, found none")
    whole = [replace(leg, first=spot.s) for spot in starts for leg in _whole(network.edges[spot.edge])]
    found = [leg for leg in whole if leg.edge not in closed or leg.direction < 0]
    if not found:
        on = ", ".join(str(spot.edge) for spot in starts)
        raise ValueError(f"no way: it stands on edge {on}, which is closed and may not be left backwards")
    return found


def _reaching(leg: Leg, goals: Sequence[Spot], least: float) -> list[Leg]:
    """Return the leg up to each goal that is at least so many m ahead on it."""
    ahead = [(leg.direction * (goal.s - leg.first), goal.s) for goal in goals if goal.edge == leg.edge]
    within = [(way, s) for way, s in ahead if least <= way <= leg.length + 1e-9]
    return [replace(leg, last=s if way > 0.0 else leg.first) for way, s in within]


def _open_ways(network: Network, closed: Collection[int]) -> Mapping[int, list[Leg]]:
    """Return the edges that may be driven, as whole legs by the node where they begin."""
    found = defaultdict[int, list[Leg]](list)
    for edge in network.edges.values():
        for leg in _whole(edge) if edge.id not in closed else ():
            found[edge.ends(leg.direction)[0]].append(leg)
    return found


def _whole(edge: RouteEdge) -> list[Leg]:
    """Return the edge as it may be driven."""
    forward, reverse = Leg(edge.id, 1, 0.0, edge.length), Leg(edge.id, -1, edge.length, 0.0)
    return [leg for leg, may in ((forward, edge.is_forward), (reverse, edge.is_reverse)) if may]


def with_laps(network: Network, route: Route, laps: int, *, cruise: float, closed: Collection[int] = ()) -> Route:
    """Return a route followed by rounds from its end back to there."""
    if not laps:
        return route
    last = route.legs[-1]
    node = network.node_at(last.edge, last.last)
    goals = [Spot(last.edge, last.last)] if node is None else network.spots_of(node)
    starts = [spot for spot in goals if node is None or spot.s == 0.0 or last.direction < 0]
    once = plan(network, starts, goals, cruise=cruise, closed=closed, is_round=True)
    return Route(route.legs + laps * once.legs, route.seconds + laps * once.seconds, len(once.legs))


def make_course(network: Network, route: Route) -> Array:
    """Return the path of a route: points (N, 4) in order of driving; ValueError for one of too many.

    Their columns are x, y, yaw of the vehicle, not of the way, and speed.
    """
    parts = [
        network.edges[leg.edge].curve.part(*sorted((leg.first, leg.last))).columns.T[:: leg.direction]
        for leg in route.legs
    ]
    points = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    if len(points) > MAX_POINTS:
        raise ValueError(f"way: expected at most {MAX_POINTS} points, found {len(points)}: fewer laps")
    return points
