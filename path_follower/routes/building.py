"""From drives to a network: what two drives share is one edge; where they part or meet is a branch.

Drives are taken one after the other. Each of its points is compared, in position and heading, with the curves that are
there already, and with what the drive itself did before. Runs alongside keep the curve that was there first. What is
left becomes a curve of its own, which begins and ends on the other ones: at the branch it has their pose and curvature
and goes over to what was driven within some metres. Curves are then cut at the branches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BPoly
from scipy.spatial import cKDTree

from path_follower.constants import SPACING
from path_follower.path import Pose2, between, turned_by
from path_follower.routes.constants import (
    ALIKE,
    BLEND,
    LANE,
    MAX_APART,
    MIN_SHARED,
    PAST,
    SAME_HEADING,
    SNAP,
    STUB,
    TURN_SCALE,
)
from path_follower.routes.network import EdgeCurve, Indices, Network, RouteEdge
from sphere_nav.geometry.arrays import Array, Flags

HERE, OWN = -1, -2  # curves that a drive may be on: what it did before (the last of them), and none that was there


@dataclass(frozen=True, eq=False)
class TaughtDrive:
    """A taught curve, driven forward (1) or backwards (-1)."""

    curve: EdgeCurve
    direction: int = 1


@dataclass(frozen=True)
class _Run:
    """Points of a drive that lie alongside one curve, or on none."""

    on: int
    first: int
    last: int

    @property
    def count(self) -> int:
        return self.last - self.first + 1


class _Place(NamedTuple):
    """A point of a curve; where another one begins or ends."""

    strand: int
    at: int


@dataclass(eq=False)
class _Strand:
    """A curve of the network before it is cut, and whether each step was driven forward, and backwards (2, N - 1)."""

    curve: EdgeCurve
    ways: Flags
    begin: _Place | None = None
    end: _Place | None = None


def build_network(drives: Sequence[TaughtDrive], map_id: str = "") -> Network:
    """Return the network of drives; the first of them begins at the place `home`."""
    if not drives:
        raise ValueError("network: expected drives, found none")
    strands: list[_Strand] = []
    for drive in drives:
        _add_drive(strands, drive)
    return _numbered(*_cut(strands), map_id)


def _add_drive(strands: list[_Strand], drive: TaughtDrive) -> None:
    """Add what a drive does not share as curves of their own; note on the others that it came by."""
    curve = drive.curve
    on, at = _alongside(strands, curve)
    runs = _with_changes(strands, at, _tidy(on, at))
    kept = slice(runs[0].first, runs[-1].last + 1)
    at[on == HERE] = np.maximum(at[on == HERE], kept.start)
    places = [_Place(*place) for place in zip(on.tolist(), at.tolist(), strict=True)]  # in the network, of each point
    for index, run in enumerate(runs):
        if run.on == OWN:
            (first, begin), (last, end) = (_branch(strands, curve, at, runs, index, side) for side in (-1, 1))
            ways = np.tile([[drive.direction > 0], [drive.direction < 0]], last - first)
            strand = _Strand(curve.between(first, last), ways)
            places[first : last + 1] = [_Place(len(strands), point) for point in range(last - first + 1)]
            strands.append(strand)
            strand.begin, strand.end = begin and _settled(places, begin), end and _settled(places, end)
            for place, is_begin in ((strand.begin, True), (strand.end, False)):
                if place is not None:
                    _blend(strand, strands[place.strand], place.at, is_begin=is_begin)
    for point in range(kept.start, kept.stop):
        place = places[point] = _settled(places, places[point])
        speed = strands[place.strand].curve.speed
        speed[place.at] = np.fmax(speed[place.at], curve.speed[point])
    for left, met in pairwise(places[kept]):
        _note(strands, left, met, int(drive.direction < 0))


def _settled(places: Sequence[_Place], place: _Place) -> _Place:
    """Return a place on a curve of the network for one on what the drive itself did before."""
    while place.strand == HERE:
        place = places[place.at]
    return place


def _note(strands: Sequence[_Strand], left: _Place, met: _Place, way: int) -> None:
    """Note on curves that they were driven (0: forward, 1: backwards) from one place to the next."""
    if left.strand == met.strand:
        strands[met.strand].ways[way, min(left.at, met.at) : max(left.at, met.at)] = True
    else:
        for end, begin in _joints(strands, left.strand, met.strand):
            _note(strands, left, end, way)
            _note(strands, begin, met, way)


def _joints(strands: Sequence[_Strand], left: int, met: int) -> list[tuple[_Place, _Place]]:
    """Return the ends of two curves where the one that is left ends on the other, or this begins on it."""
    end = _Place(left, len(strands[left].curve) - 1), strands[left].end
    begin = strands[met].begin, _Place(met, 0)
    return [(a, b) for a, b in (end, begin) if a is not None and b is not None and (a.strand, b.strand) == (left, met)]


# --- alongside
def _alongside(strands: Sequence[_Strand], curve: EdgeCurve) -> tuple[Indices, Indices]:
    """Return on which curve each point of a drive lies, and where; the one that is followed counts while it is near."""
    curves = [*(strand.curve for strand in strands), curve]
    off, near = map(np.array, zip(*(_near(there, curve) for there in curves), strict=True))
    on, at = np.full(len(curve), OWN), np.full(len(curve), -1)
    for point in range(len(curve)):
        followed = on[point - 1] if point else OWN
        if followed != OWN:
            ahead = _ahead(curves[followed], curve, point, at[point - 1])
            at[point] = ahead if ahead >= 0 else near[followed, point]
        if at[point] < 0:
            best = np.argmin(off[:, point])
            followed, at[point] = HERE if best == len(strands) else best, near[best, point]
        on[point] = followed if at[point] >= 0 else OWN
    return on, at


def _ahead(there: EdgeCurve, curve: EdgeCurve, point: int, last: int) -> int:
    """Return where a point of a drive is on the curve that it follows, just ahead of the last one; -1: off its lane."""
    at = np.arange(last, min(last + round(1.0 / SPACING), len(there)), dtype=np.intp)
    best = at[np.argmin(np.hypot(there.x[at] - curve.x[point], there.y[at] - curve.y[point]))]
    is_past = there is not curve or point - best > PAST / SPACING
    return int(_on_lane(there, curve, best, point)[1]) if is_past else -1


def _near(there: EdgeCurve, curve: EdgeCurve) -> tuple[Array, Indices]:
    """Return the distance of each point of a drive from a curve, and the index there, -1: not on its lane.

    Of the drive itself only what is PAST m behind counts.
    """
    known, features, points = _features(there), _features(curve), np.arange(len(curve))
    if there is not curve:
        return _on_lane(there, curve, _nearest(known, features), points)
    off, at = np.full(len(curve), np.inf), np.full(len(curve), -1)
    past, block = round(PAST / SPACING), round(5.0 / SPACING)
    for begin in range(past + 1, len(curve), block):
        some = points[begin : begin + block]
        off[some], at[some] = _on_lane(curve, curve, _nearest(known[: begin - past], features[some]), some)
    return off, at


def _features(curve: EdgeCurve) -> Array:
    turned = (TURN_SCALE * np.cos(curve.yaw), TURN_SCALE * np.sin(curve.yaw))
    return np.stack([curve.x, curve.y, *turned], axis=-1)


def _nearest(known: Array, features: Array) -> Indices:
    """Return which of known features (N, 4) is the nearest to each of others (M, 4); any where none is near."""
    reach = math.hypot(LANE, TURN_SCALE * SAME_HEADING)
    _, at = cKDTree(known).query(features, distance_upper_bound=reach)
    return np.minimum(at, len(known) - 1)


def _on_lane(there: EdgeCurve, curve: EdgeCurve, at: Indices, points: Indices | int) -> tuple[Array, Indices]:
    off, turned = _apart(there, curve, at, points)
    is_near = (off <= LANE) & (turned <= SAME_HEADING)
    return np.where(is_near, off, np.inf), np.where(is_near, at, -1)


def _apart(there: EdgeCurve, curve: EdgeCurve, at: Indices, points: Indices | int) -> tuple[Array, Array]:
    """Return m and rad between points of two curves."""
    off = np.hypot(there.x[at] - curve.x[points], there.y[at] - curve.y[points])
    return off, turned_by(there.yaw[at], curve.yaw[points])


# --- runs
def _runs(on: Indices, at: Indices) -> list[_Run]:
    """Return the runs of points on the same curve without a leap of more than 2 m."""
    is_last = (np.diff(on) != 0) | ((on[1:] != OWN) & (np.abs(np.diff(at)) > 2.0 / SPACING))
    ends = [-1, *np.flatnonzero(is_last).tolist(), len(on) - 1]
    return [_Run(int(on[last]), before + 1, last) for before, last in pairwise(ends)]


def _tidy(on: Indices, at: Indices) -> list[_Run]:
    """Return runs after gaps between runs along the same curve are closed, short ones and stubs dropped."""
    runs = _runs(on, at)
    for before, run, after in zip(runs, runs[1:], runs[2:], strict=False):
        gone = at[after.first] - at[before.last]
        is_gap = run.on == OWN and before.on == after.on != OWN
        if is_gap and run.count <= MAX_APART / SPACING and abs(gone - run.count) <= 2.0 / SPACING:
            on[run.first : after.first] = before.on
            at[run.first : after.first] = np.linspace(at[before.last], at[after.first], run.count + 2)[1:-1]
    for run in _runs(on, at)[1:-1]:
        if run.count < MIN_SHARED / SPACING:
            on[run.first : run.last + 1] = OWN
    runs = _runs(on, at)
    for end in (0, -1):
        if len(runs) > 1 and runs[end].on == OWN and runs[end].count < STUB / SPACING:
            del runs[end]
    return runs


def _with_changes(strands: Sequence[_Strand], at: Indices, runs: list[_Run]) -> list[_Run]:
    """Put a curve of its own between runs that follow each other on curves that are not connected: a change of lane."""
    half = round(MIN_SHARED / SPACING)
    result = runs[:1]
    for run in runs[1:]:
        last = result[-1]
        ends = _Place(last.on, int(at[last.last])), _Place(run.on, int(at[run.first]))
        if OWN not in (last.on, run.on) and not _are_connected(strands, *ends):
            left, met = max(last.first, last.last - half), min(run.last, run.first + half)
            result[-1] = replace(last, last=left)
            result.append(_Run(OWN, left + 1, met - 1))
            run = replace(run, first=met)
        result.append(run)
    return result


def _are_connected(strands: Sequence[_Strand], left: _Place, met: _Place) -> bool:
    """Whether the curve that is left ends on that which is met, or this begins on it, about where they change over."""
    if HERE in (left.strand, met.strand):
        return False
    near, joints = (BLEND + 2.0) / SPACING, _joints(strands, left.strand, met.strand)
    return any(abs(end.at - left.at) <= near and abs(begin.at - met.at) <= near for end, begin in joints)


# --- branches
def _branch(
    strands: Sequence[_Strand], curve: EdgeCurve, at: Indices, runs: Sequence[_Run], index: int, side: int
) -> tuple[int, _Place | None]:
    """Return where a run of its own begins (-1) or ends (1): on the drive, and on the curve there; None: on none."""
    run, near = runs[index], index + side
    if not 0 <= near < len(runs):
        return run.first if side < 0 else run.last, None
    other, window = runs[near], round(BLEND / SPACING)
    share = (other.count + 1) // 2 if 0 <= near + side < len(runs) else other.count
    missing = max(0, window - run.count)  # a short one begins sooner and ends later, so that there is room to blend
    late = max(1, other.count - missing)
    offsets = np.arange(max(0, late - min(window, share)), late)
    points = other.first + offsets if side < 0 else other.last - offsets[::-1]
    there = curve if other.on == HERE else strands[other.on].curve
    best = _most_alike(there, curve, at[points], points)[-1 if side < 0 else 0]
    found, last = int(at[best]), len(there) - 1
    end = 0 if found <= SNAP else last if found >= last - SNAP and other.on != HERE else found
    return int(best), _Place(other.on, end)


def _most_alike(there: EdgeCurve, curve: EdgeCurve, at: Indices, points: Indices) -> Indices:
    """Return those of the points of a drive that are most alike, in pose and curvature, to points of a curve."""
    off, turned = _apart(there, curve, at, points)
    cost = off + 3.0 * turned + 4.0 * np.abs(there.bend[at] - curve.bend[points])
    return points[cost <= cost.min() + ALIKE]


def _blend(strand: _Strand, other: _Strand, at: int, *, is_begin: bool) -> None:
    """Let a curve begin (or end) with the pose and curvature of a point of another one.

    The offset from what was driven fades out over BLEND m by the polynomial of fifth degree that has it, its slope and
    its curvature at the branch, and none of them at the other end.
    """
    curve, sign = strand.curve, 1.0 if is_begin else -1.0
    here, target = (0 if is_begin else len(curve) - 1), other.curve.point(at)
    ahead, left, turn = between(curve.point(here), target)
    slope = sign * math.tan(turn)
    bend = float(other.curve.bend[at] - curve.bend[here])
    way = curve.arc if is_begin else curve.length - curve.arc
    is_between = strand.begin is not None and strand.end is not None
    span = max(min(BLEND, curve.length / (2.0 if is_between else 1.0)), 1e-6)
    shift = _fade(np.minimum(way / span, 1.0), left, slope * span, bend * span**2)
    along = ahead * _fade(np.minimum(way / span, 1.0), 1.0, 0.0, 0.0)
    x = curve.x - shift * np.sin(curve.yaw) + along * np.cos(curve.yaw)
    y = curve.y + shift * np.cos(curve.yaw) + along * np.sin(curve.yaw)
    turned = np.arctan2(np.gradient(y), np.gradient(x))
    turned[here] = target.yaw
    turned = np.where(way < span, curve.yaw + (turned - curve.yaw + np.pi) % (2.0 * np.pi) - np.pi, curve.yaw)
    strand.curve = EdgeCurve(x, y, np.unwrap(turned), curve.speed)


def _fade(u: Array, value: float, slope: float, bend: float) -> Array:
    """Return the polynomial of fifth degree with this value, slope and second derivative at 0, and zero ones at 1."""
    return np.asarray(BPoly.from_derivatives([0.0, 1.0], [[value, slope, bend], [0.0, 0.0, 0.0]])(u))


# --- nodes and edges
def _cut(strands: Sequence[_Strand]) -> tuple[list[Pose2], list[RouteEdge]]:
    """Return poses where curves are cut, the first is that of `home`, and edges between them by their numbers."""
    places: dict[_Place, int] = {}
    edges: list[RouteEdge] = []

    def node(place: _Place) -> int:
        item = strands[place.strand]
        joint = item.begin if place.at == 0 else item.end if place.at == len(item.curve) - 1 else None
        return places.setdefault(place, len(places)) if joint in (None, place) else node(joint)

    joints = {place for strand in strands for place in (strand.begin, strand.end) if place is not None}
    for index, strand in enumerate(strands):
        changes = np.flatnonzero(np.any(strand.ways[:, 1:] != strand.ways[:, :-1], axis=0)) + 1
        cuts = {0, len(strand.curve) - 1, *changes.tolist(), *(at for on, at in joints if on == index)}
        for first, last in pairwise(sorted(cuts)):
            ends = node(_Place(index, first)), node(_Place(index, last))
            may = strand.ways[:, first].tolist()
            edges.append(RouteEdge(0, *ends, strand.curve.between(first, last), *may))
    return [strands[place.strand].curve.point(place.at) for place in places], edges


def _numbered(poses: Sequence[Pose2], edges: list[RouteEdge], map_id: str) -> Network:
    """Return the network without nodes at which nothing branches, and with numbers from 1.

    No number stands for a node and for an edge, as Nav2's Route Server wants it.
    """
    for node in range(1, len(poses)):
        _dissolve(edges, node)
    used = sorted({node for edge in edges for node in (edge.start, edge.end)})
    names = {node: name for name, node in enumerate(used, 1)}
    numbered = {
        name: replace(edge, id=name, start=names[edge.start], end=names[edge.end])
        for name, edge in enumerate(edges, len(names) + 1)
    }
    return Network({name: poses[node] for node, name in names.items()}, numbered, {"home": names[0]}, map_id)


def _dissolve(edges: list[RouteEdge], node: int) -> None:
    """Join edges at a node where there is only one way on, driven alike."""
    before, after = [edge for edge in edges if edge.end == node], [edge for edge in edges if edge.start == node]
    if len(before) != 1 or len(after) != 1 or before == after:
        return
    a, b = before[0], after[0]
    if (a.is_forward, a.is_reverse) == (b.is_forward, b.is_reverse):
        x, y, yaw, speed = np.concatenate([a.curve.columns, b.curve.columns[:, 1:]], axis=1)
        edges[edges.index(a)] = replace(a, end=b.end, curve=EdgeCurve(x, y, np.unwrap(yaw), speed))
        edges.remove(b)
