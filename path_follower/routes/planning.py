"""The quickest way over a network: Dijkstra over edges and the direction in which each is driven.

States are directed edges, not nodes, so that a change of direction (a cusp) has its cost, and so that a round can end
on the edge that it began on.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count

from path_follower.routes.constants import AT_PLACE, CUSP_COST, REVERSE_COST
from path_follower.routes.network import Network, RouteEdge, Spot


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
    """Legs in order of driving, and how long they take at the cruise speed asked for."""

    legs: tuple[Leg, ...]
    seconds: float

    @property
    def length(self) -> float:
        """Way in m."""
        return sum(leg.length for leg in self.legs)


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

    def add(cost: float, leg: Leg, before: tuple[Leg, ...] = ()) -> None:
        """Add a leg, and its part up to each goal on it; one just behind the start is reached, but not by a round."""
        edge = network.edges[leg.edge]
        pace = _pace(edge, cruise) * (1.0 if leg.direction > 0 else REVERSE_COST)
        least = 0.0 if before else AT_PLACE if is_round else -AT_PLACE
        heapq.heappush(queue, (cost + pace * leg.length, next(numbers), False, (*before, leg)))
        for s in (goal.s for goal in goals if goal.edge == edge.id):
            ahead = leg.direction * (s - leg.first)
            if least <= ahead <= leg.length + 1e-9:
                part = replace(leg, last=s if ahead > 0.0 else leg.first)
                heapq.heappush(queue, (cost + pace * max(ahead, 0.0), next(numbers), True, (*before, part)))

    for leg in _first(network, starts, closed):
        add(0.0, leg)
    done: set[tuple[int, int, bool]] = set()
    while queue:
        cost, _, is_end, legs = heapq.heappop(queue)
        if is_end:
            return Route(legs, sum(_pace(network.edges[leg.edge], cruise) * leg.length for leg in legs))
        leg = legs[-1]
        key = leg.edge, leg.direction, len(legs) == 1  # a part of an edge stands for no whole one
        if key in done:
            continue
        done.add(key)
        for following in _next(network, leg, closed):
            add(cost + CUSP_COST * (following.direction != leg.direction), following, legs)
    named = f" while {', '.join(map(str, sorted(closed)))} are closed" if closed else ""
    raise ValueError(f"no way: no edges lead there from here{named}")


def _pace(edge: RouteEdge, cruise: float) -> float:
    """Return how many seconds a metre of an edge takes."""
    return edge.seconds(cruise) / max(edge.length, 1e-9)


def _first(network: Network, starts: Sequence[Spot], closed: Collection[int]) -> list[Leg]:
    """Return the legs on which it may begin; ValueError where there is none."""
    if not starts:
        raise ValueError("no way: expected a start on the network, found none")
    found = [
        replace(leg, first=spot.s)
        for spot in starts
        for leg in _whole(network.edges[spot.edge])
        if spot.edge not in closed or leg.direction < 0
    ]
    if not found:
        on = ", ".join(str(spot.edge) for spot in starts)
        raise ValueError(f"no way: it stands on edge {on}, which is closed and may not be left backwards")
    return found


def _whole(edge: RouteEdge) -> list[Leg]:
    """Return the edge as it may be driven."""
    forward, reverse = Leg(edge.id, 1, 0.0, edge.length), Leg(edge.id, -1, edge.length, 0.0)
    return [leg for leg, may in ((forward, edge.is_forward), (reverse, edge.is_reverse)) if may]


def _next(network: Network, leg: Leg, closed: Collection[int]) -> Iterator[Leg]:
    """Yield the whole directed edges that follow."""
    _, node = network.edges[leg.edge].ends(leg.direction)
    for other in network.edges.values():
        if other.id not in closed:
            yield from (one for one in _whole(other) if other.ends(one.direction)[0] == node)


def with_laps(network: Network, route: Route, laps: int, *, cruise: float, closed: Collection[int] = ()) -> Route:
    """Return a route followed by rounds from its end back to there."""
    if not laps:
        return route
    last = route.legs[-1]
    edge = network.edges[last.edge]
    is_node = last.last in (0.0, edge.length)
    node = edge.end if last.last > 0.0 else edge.start
    goals = network.spots_of(node) if is_node else [Spot(last.edge, last.last)]
    starts = [spot for spot in goals if not is_node or spot.s == 0.0 or last.direction < 0]
    once = plan(network, starts, goals, cruise=cruise, closed=closed, is_round=True)
    return Route(route.legs + laps * once.legs, route.seconds + laps * once.seconds)
