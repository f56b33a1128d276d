"""The reference trajectory u* = {x, y, yaw, U, yaw rate} (M15 eq. 21), and where on it a pose is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from path_follower.constants import CREEP, MAX_OFF_HEADING, SAME_DIRECTION, SAME_PLACE
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array


class Pose2(NamedTuple):
    """Pose of the rear-axle centre in the frame of the path: m, m, rad."""

    x: float
    y: float
    yaw: float

    @staticmethod
    def of(T_map_base: SE3) -> Pose2:
        """Return the pose on the ground."""
        x, y, _ = T_map_base.translation.tolist()
        return Pose2(x, y, float(T_map_base.yaw))


@dataclass(frozen=True)
class ReferencePoint:
    """One input vector u* (eq. 21) with what belongs to it."""

    x: float
    y: float
    yaw: float
    speed: float  # U*, negative backwards
    yaw_rate: float  # at that speed
    curvature: float  # 1/m, d yaw over signed way
    arc_length: float
    direction: int  # 1 forward, -1 backward


@dataclass(frozen=True)
class Location:
    """The foot of a pose on the path: m along, edge, and m to the left of the edge as the vehicle heads."""

    arc_length: float
    segment: int
    edge: int
    cross_track: float
    distance: float  # to the foot; larger than |cross_track| beyond the ends
    heading_error: float


@dataclass(frozen=True)
class Segment:
    """Points first ... last that are driven in one direction."""

    first: int
    last: int
    direction: int


@dataclass(frozen=True, eq=False)
class ReferencePath:
    """Points (N,) in order of driving; made by `taught.py` or `path_files.py`.

    `arc_length` never decreases; where the direction changes (a cusp) a point stands twice. `curvature` is by signed
    way: the yaw rate is `speed * curvature`.
    """

    x: Array
    y: Array
    yaw: Array  # unwrapped within a segment
    curvature: Array
    arc_length: Array
    speed: Array
    segments: tuple[Segment, ...]
    map_id: str = ""  # of the map in whose frame it is; empty: unknown
    possible: Array | None = None  # speed (N,) if nothing but the cruise speed were another one; None: `speed`

    @property
    def length(self) -> float:
        """Arc length of the last point, in metres."""
        return float(self.arc_length[-1])

    @property
    def max_curvature(self) -> float:
        """Curvature of the sharpest bend, 1/m."""
        return float(np.abs(self.curvature).max())

    def __len__(self) -> int:
        return len(self.x)

    def at_cruise(self, cruise: float) -> ReferencePath:
        """Return the path with another cruise speed: what is braked and sped up for stays as it is below it."""
        possible, cruise = self.speed if self.possible is None else self.possible, max(cruise, CREEP)
        return replace(self, speed=np.clip(possible, -cruise, cruise), possible=possible)

    def end_of(self, segment: int) -> float:
        """Return the arc length at which a segment ends."""
        return float(self.arc_length[self.segments[segment].last])

    def at(self, arc_length: float, segment: int) -> ReferencePoint:
        """Return the reference at an arc length, kept within its segment."""
        part = self.segments[segment]
        own = slice(part.first, part.last + 1)
        columns = self.arc_length, self.x, self.y, self.yaw, self.speed, self.curvature
        s, x, y, yaw, speed, curvature = (
            float(np.interp(arc_length, self.arc_length[own], column[own])) for column in columns
        )
        return ReferencePoint(x, y, wrap(yaw), speed, speed * curvature, curvature, s, part.direction)

    def advance(self, pose: Pose2, last: Location, window: float) -> Location:
        """Return the foot of a pose on the closest edge within `window` m ahead of the last foot, never behind it.

        It stays in the segment of the last foot, so that neither a crossing, nor a parallel lane, nor what follows a
        cusp can take the vehicle away from its place in the sequence.
        """
        part = self.segments[last.segment]
        first = self._edge_at(last.arc_length, part)
        count = max(2, int(np.searchsorted(self.arc_length[: part.last + 1], last.arc_length + window)) - first)
        edges = np.arange(first, min(first + count, part.last))
        share, distance = self._feet(pose, edges)
        best = int(np.argmin(distance))
        found = self._location(pose, float(share[best]), float(distance[best]), int(edges[best]), last.segment)
        return replace(found, arc_length=max(found.arc_length, last.arc_length))

    def locate(self, pose: Pose2) -> Location | None:
        """Search the whole path for a start: the closest edge that heads as the pose does; None if none does.

        Where the path comes by more than once, as a taught loop does at its end, the earliest of the passes counts; at
        a crossing they head differently, and the one counts that heads as the pose does.
        """
        edges = np.concatenate([np.arange(part.first, part.last) for part in self.segments])
        share, distance = self._feet(pose, edges)
        turned = turned_by(self.yaw[edges], pose.yaw)
        distance = np.where(turned <= MAX_OFF_HEADING, distance, np.inf)
        if not np.isfinite(distance).any():
            return None
        near = distance <= distance.min() + SAME_PLACE
        near &= turned <= turned[near].min() + SAME_DIRECTION
        first = int(np.argmax(near))
        last = first + int(np.argmin(np.append(near[first:], False)))
        best = first + int(np.argmin(distance[first:last]))
        edge = int(edges[best])
        segment = next(i for i, part in enumerate(self.segments) if part.first <= edge < part.last)
        return self._location(pose, float(share[best]), float(distance[best]), edge, segment)

    def begin_of(self, segment: int) -> Location:
        """Return the first point of a segment as a location."""
        first = self.segments[segment].first
        return Location(float(self.arc_length[first]), segment, first, 0.0, 0.0, 0.0)

    def _edge_at(self, s: float, part: Segment) -> int:
        after = int(np.searchsorted(self.arc_length[part.first : part.last + 1], s, side="right")) + part.first
        return min(max(after - 1, part.first), part.last - 1)

    def _feet(self, pose: Pose2, edges: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return where on edges (N,) a pose is closest, as shares (N,) of them, and how far it is from there."""
        begin = np.stack([self.x[edges], self.y[edges]])
        step = np.stack([self.x[edges + 1], self.y[edges + 1]]) - begin
        off = np.array([[pose.x], [pose.y]]) - begin
        share = np.clip(np.sum(off * step, axis=0) / np.maximum(np.sum(step * step, axis=0), 1e-18), 0.0, 1.0)
        return share, np.hypot(*(off - share * step))

    def _location(self, pose: Pose2, share: float, distance: float, edge: int, segment: int) -> Location:
        x, y, yaw, s = (
            float(column[edge] + share * (column[edge + 1] - column[edge]))
            for column in (self.x, self.y, self.yaw, self.arc_length)
        )
        _, left, turned = between(Pose2(x, y, yaw), pose)
        return Location(s, segment, edge, left, distance, turned)


def between(a: Pose2, b: Pose2) -> Pose2:
    """Return b as seen from a."""
    cosine, sine, dx, dy = math.cos(a.yaw), math.sin(a.yaw), b.x - a.x, b.y - a.y
    return Pose2(cosine * dx + sine * dy, -sine * dx + cosine * dy, wrap(b.yaw - a.yaw))


def turned_by(yaw: Array, other: Array | float) -> Array:
    """Return the angles (N,) between headings, 0 to pi."""
    return np.abs((yaw - other + np.pi) % (2.0 * np.pi) - np.pi)


def wrap(angle: float) -> float:
    """Return the angle in -pi to pi."""
    return math.remainder(angle, 2.0 * math.pi)
