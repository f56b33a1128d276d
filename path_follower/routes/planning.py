"""The quickest way over a network: Dijkstra over edges and the direction in which each is driven.

States are directed edges, not nodes, so that a change of direction (a cusp) has its cost, and so that a round can end
on the edge that it began on.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

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
    starts: Iterable[Spot],
    goals: Iterable[Spot],
    *,
    cruise: float,
    closed: Collection[int] = (),
    is_round: bool = False,
) -> Route:
    """Return the quickest way from one of the starts to one of the goals; ValueError where there is none.

    `is_round`: to where it starts, once around. Edges that are closed are not driven; a vehicle that stands on one may
    leave it backwards, where that is allowed.
    """
    targets: dict[int, list[float]] = {}
    for goal in goals:
        targets.setdefault(goal.edge, []).append(goal.s)
    queue = _first(network, list(starts), targets, cruise, closed, is_round=is_round)
    count = len(queue)
    done: set[tuple[int, int]] = set()
    while queue:
        cost, _, is_end, leg, trail = heapq.heappop(queue)
        if is_end:
            return Route(tuple(_legs(leg, trail)), _seconds(network, leg, trail, cruise))
        if trail is not None:
            if (leg.edge, leg.direction) in done:
                continue
            done.add((leg.edge, leg.direction))
        for edge, direction, extra in _next(network, leg, closed):
            if (edge.id, direction) in done:
                continue
            whole = Leg(edge.id, direction, *((0.0, edge.length) if direction > 0 else (edge.length, 0.0)))
            for more, reached, ends in _reach(edge, whole, targets, cruise, 0.0, False):
                heapq.heappush(queue, (cost + extra + more, count, ends, reached, (leg, trail)))
                count += 1
    named = f" while {', '.join(map(str, sorted(closed)))} are closed" if closed else ""
    raise ValueError(f"no way: no edges lead there from here{named}")


_Trail = tuple[Leg, "_Trail"] | None


def _first(
    network: Network,
    starts: list[Spot],
    targets: dict[int, list[float]],
    cruise: float,
    closed: Collection[int],
    *,
    is_round: bool,
) -> list[tuple[float, int, bool, Leg, _Trail]]:
    """Return the queue of legs that begin at a start: cost, number, whether it ends there, leg, what came before."""
    queue: list[tuple[float, int, bool, Leg, _Trail]] = []
    for spot in starts:
        edge = network.edges[spot.edge]
        for direction in _directions(edge):
            if edge.id not in closed or direction < 0:
                leg = Leg(edge.id, direction, spot.s, edge.length if direction > 0 else 0.0)
                for cost, reached, is_end in _reach(
                    edge, leg, targets, cruise, 0.0 if is_round else AT_PLACE, is_round
                ):
                    heapq.heappush(queue, (cost, len(queue), is_end, reached, None))
    if not starts:
        raise ValueError("no way: expected a start on the network, found none")
    if not queue:
        stands = ", ".join(str(spot.edge) for spot in starts)
        raise ValueError(f"no way: it stands on edge {stands}, which is closed and may not be left backwards")
    return queue


def _directions(edge: RouteEdge) -> list[int]:
    return [sign for sign, may in ((1, edge.is_forward), (-1, edge.is_reverse)) if may]


def _reach(
    edge: RouteEdge, leg: Leg, targets: dict[int, list[float]], cruise: float, slack: float, is_round: bool
) -> Iterator[tuple[float, Leg, bool]]:
    """Yield the cost of the leg to its end, and of its part up to each goal on it; whether a goal is reached."""
    pace = edge.seconds(cruise) / max(edge.length, 1e-9) * (1.0 if leg.direction > 0 else REVERSE_COST)
    yield pace * leg.length, leg, False
    for s in targets.get(edge.id, ()):
        ahead = leg.direction * (s - leg.first)
        if -slack <= ahead <= leg.length + 1e-9 and not (is_round and ahead < AT_PLACE):
            last = leg.first if ahead < 0.0 else s
            yield pace * max(ahead, 0.0), Leg(edge.id, leg.direction, leg.first, last), True


def _next(network: Network, leg: Leg, closed: Collection[int]) -> Iterator[tuple[RouteEdge, int, float]]:
    """Yield the directed edges that follow, with the cost of a cusp where the direction changes."""
    edge = network.edges[leg.edge]
    node = edge.end if leg.direction > 0 else edge.start
    for other in network.edges.values():
        if other.id in closed:
            continue
        if other.start == node and other.is_forward:
            yield other, 1, 0.0 if leg.direction > 0 else CUSP_COST
        if other.end == node and other.is_reverse:
            yield other, -1, 0.0 if leg.direction < 0 else CUSP_COST


def _legs(leg: Leg, trail: _Trail) -> list[Leg]:
    legs = [leg]
    while trail is not None:
        before, trail = trail
        legs.append(before)
    return legs[::-1]


def _seconds(network: Network, leg: Leg, trail: _Trail, cruise: float) -> float:
    total = 0.0
    for part in _legs(leg, trail):
        edge = network.edges[part.edge]
        total += edge.seconds(cruise) * part.length / max(edge.length, 1e-9)
    return total


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
