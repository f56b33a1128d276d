"""A network of taught paths: nodes are poses, edges the curves between them, places are nodes with a name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from path_follower.path import Pose2, between, turned_by
from path_follower.routes.constants import MAX_NAME
from path_follower.smoothing import Curve as Curve


@dataclass(frozen=True, eq=False)
class RouteEdge:
    """A curve from one node to another, and how it may be driven."""

    id: int
    start: int
    end: int
    curve: Curve
    is_forward: bool = True  # may be driven from its start to its end
    is_reverse: bool = False  # may be driven backwards from its end to its start

    @property
    def length(self) -> float:
        """Length in m."""
        return self.curve.length

    def ends(self, direction: int) -> tuple[int, int]:
        """Return the nodes where it begins and ends, driven forward (1) or backwards (-1)."""
        return (self.start, self.end) if direction > 0 else (self.end, self.start)

    def seconds(self, cruise: float) -> float:
        """Return how long it takes at the taught speeds, at most `cruise` m/s."""
        speed = np.clip(np.where(np.isfinite(self.curve.speed), self.curve.speed, cruise), 0.3, cruise)
        return float(np.sum(2.0 * np.diff(self.curve.arc) / (speed[1:] + speed[:-1])))

    def pace(self, cruise: float) -> float:
        """Return how many seconds a metre takes."""
        return self.seconds(cruise) / max(self.length, 1e-9)


@dataclass(frozen=True)
class Spot:
    """A place on an edge, m from its start; where one was looked for: m that it is to the left, rad turned."""

    edge: int
    s: float
    left: float = 0.0
    turned: float = 0.0


@dataclass(frozen=True, eq=False)
class Network:
    """Nodes, edges and places of one map. A node is the pose at which edges begin and end; all head as it does."""

    nodes: Mapping[int, Pose2]
    edges: Mapping[int, RouteEdge]
    places: Mapping[str, int] = field(default_factory=dict)  # node by name
    map_id: str = ""

    def arrivals(self, node: int) -> list[RouteEdge]:
        """Return the edges that end at a node."""
        return [edge for edge in self.edges.values() if edge.end == node]

    def departures(self, node: int) -> list[RouteEdge]:
        """Return the edges that begin at a node."""
        return [edge for edge in self.edges.values() if edge.start == node]

    def spots_of(self, node: int) -> list[Spot]:
        """Return a node as the ends and the beginnings of its edges."""
        ends = [Spot(edge.id, edge.length) for edge in self.arrivals(node)]
        return ends + [Spot(edge.id, 0.0) for edge in self.departures(node)]

    def node_at(self, edge: int, s: float) -> int | None:
        """Return the node that an edge has at one of its ends, `s` m from its start; None elsewhere."""
        found = self.edges[edge]
        return {0.0: found.start, found.length: found.end}.get(s)

    def name_of(self, node: int | None) -> str:
        """Return the name of a place, or an empty text."""
        return next((name for name, number in self.places.items() if number == node), "")

    def node_of(self, place: str) -> int:
        """Return the node of a place; ValueError for an unknown one."""
        if place not in self.places:
            known = ", ".join(sorted(self.places)) or "none, see sphere_nav route name"
            raise ValueError(f"place: expected one of {known}, found {place!r}")
        return self.places[place]

    def locate(self, pose: Pose2, reach: float, max_turn: float) -> list[Spot]:
        """Return the closest spot of each edge within `reach` m and `max_turn` rad of a pose, the closest first."""
        found = [spot for edge in self.edges.values() if (spot := _foot(edge, pose, reach, max_turn)) is not None]
        return sorted(found, key=lambda spot: abs(spot.left) + abs(spot.turned))

    def with_place(self, name: str, spot: Spot) -> Network:
        """Return the network with a named place: at a node that is closer than 0.5 m, else the edge is cut there."""
        if not name or len(name) > MAX_NAME or not name.isprintable():
            raise ValueError(f"place: expected a name of 1 to {MAX_NAME} printable characters, found {name[:80]!r}")
        edge = self.edges[spot.edge]
        for node, way in ((edge.start, spot.s), (edge.end, edge.length - spot.s)):
            if way < 0.5:
                return replace(self, places={**self.places, name: node})
        new = max(*self.nodes, *self.edges) + 1
        before = replace(edge, end=new, curve=edge.curve.part(0.0, spot.s))
        after = replace(edge, id=new + 1, start=new, curve=edge.curve.part(spot.s, edge.length))
        nodes = {**self.nodes, new: edge.curve.pose(spot.s)}
        edges = {**self.edges, edge.id: before, after.id: after}
        return replace(self, nodes=nodes, edges=edges, places={**self.places, name: new})


def _foot(edge: RouteEdge, pose: Pose2, reach: float, max_turn: float) -> Spot | None:
    """Return the spot of an edge that is closest to a pose, of those that head as it does."""
    curve = edge.curve
    turned = turned_by(curve.yaw, pose.yaw)
    distance = np.where(turned <= max_turn, np.hypot(curve.x - pose.x, curve.y - pose.y), np.inf)
    best = int(np.argmin(distance))
    if not np.isfinite(distance[best]):
        return None
    step = between(curve.point(best), pose)
    foot = float(curve.arc[best]) + step.x
    s = min(max(foot, 0.0), edge.length)
    return None if math.hypot(step.y, foot - s) > reach else Spot(edge.id, s, step.y, step.yaw)


Indices = NDArray[np.intp]
