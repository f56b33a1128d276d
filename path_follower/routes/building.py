"""From drives to a network: what two drives share is one edge; where they part or meet is a branch.

Drives are taken one after the other. Each of its points is compared, in position and heading, with the curves that are
there already, and with what the drive itself did before. Runs alongside keep the curve that was there first. What is
left becomes a curve of its own, which begins and ends on the other ones: at the branch it has their pose and curvature
and goes over to what was driven within some metres. Curves are then cut at the branches.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BPoly
from scipy.spatial import cKDTree

from path_follower.constants import SPACING
from path_follower.path import between, turned_by
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

OWN, HERE = -1, -2  # of a run: on no curve that was there; on what the drive itself did before


@dataclass(frozen=True, eq=False)
class TaughtDrive:
    """A taught curve, driven forward (1) or backwards (-1)."""

    curve: EdgeCurve
    direction: int = 1


@dataclass(frozen=True, eq=False)
class _Run:
    """Points of a drive from `first` on that lie alongside points `at` of a curve, or on none."""

    on: int
    first: int
    at: Indices

    @property
    def count(self) -> int:
        return len(self.at)

    @property
    def last(self) -> int:
        return self.first + len(self.at) - 1


class _Anchor(NamedTuple):
    """A point of a curve where another one begins or ends."""

    strand: int
    at: int


@dataclass(eq=False)
class _Strand:
    """A curve of the network before it is cut, and whether each point was driven forward, and backwards (2, N)."""

    curve: EdgeCurve
    ways: Flags
    begin: _Anchor | None = None
    end: _Anchor | None = None
    cuts: set[int] = field(default_factory=set)


def build_network(drives: Sequence[TaughtDrive], map_id: str = "") -> Network:
    """Return the network of drives; the first of them begins at the place `home`."""
    if not drives:
        raise ValueError("network: expected drives, found none")
    strands: list[_Strand] = []
    for drive in drives:
        _add_drive(strands, drive)
    return _cut(strands, map_id)


# --- alongside
def _add_drive(strands: list[_Strand], drive: TaughtDrive) -> None:
    """Add what a drive does not share as curves of their own; note on the others that it came by."""
    runs = _tidy(strands, _runs_of(strands, drive.curve), drive.curve)
    known, pieces = len(strands), list[_Run]()
    for index, run in enumerate(runs):
        if run.on == OWN:
            (first, begin), (last, end) = (_anchor(strands, drive.curve, runs, index, side) for side in (-1, 1))
            pieces.append(_Run(len(strands), first, np.arange(last - first + 1)))
            ways = np.tile([[drive.direction > 0], [drive.direction < 0]], last - first + 1)
            strands.append(_Strand(drive.curve.between(first, last), ways, begin, end))
    shared = [run for run in runs if run.on != OWN]
    for strand in strands[known:]:
        strand.begin, strand.end = (at and _resolve(pieces, shared, at) for at in (strand.begin, strand.end))
        for anchor, is_begin in ((strand.begin, True), (strand.end, False)):
            if anchor is not None:
                _blend(strand, strands[anchor.strand], anchor.at, is_begin=is_begin)
                strands[anchor.strand].cuts.add(anchor.at)
    for run in shared:
        for point, at in enumerate(run.at.tolist(), run.first):
            anchor = _resolve(pieces, shared, _Anchor(run.on, at))
            strand = strands[anchor.strand]
            strand.curve.speed[anchor.at] = np.fmax(strand.curve.speed[anchor.at], drive.curve.speed[point])
            strand.ways[int(drive.direction < 0), anchor.at] = True


def _resolve(pieces: Sequence[_Run], shared: Sequence[_Run], met: _Anchor) -> _Anchor:
    """Return the point of a curve that was met; of what the drive itself did, where that has gone, by its parts."""
    on, at = met
    if on != HERE:
        return met
    inside = [part for part in (*pieces, *shared) if part.first <= at <= part.last]
    (part, *_) = inside or sorted(pieces or shared, key=lambda part: max(part.first - at, at - part.last))
    there = int(part.at[min(max(at - part.first, 0), part.count - 1)])
    return _resolve(pieces, shared, _Anchor(part.on, there))


def _runs_of(strands: Sequence[_Strand], curve: EdgeCurve) -> list[_Run]:
    """Return runs of points that lie alongside the same curve; one that is followed is kept as long as it is near."""
    found = {k: _alongside(strand.curve, curve) for k, strand in enumerate(strands)}
    found[HERE] = _alongside_itself(curve)
    runs: list[_Run] = []
    on = OWN
    for point in range(len(curve)):
        near = {k: (off[point], at[point]) for k, (off, at) in found.items() if at[point] >= 0}
        last = int(runs[-1].at[-1]) if runs else -1
        if on != OWN and (ahead := _ahead(curve if on == HERE else strands[on].curve, curve, point, last)) >= 0:
            near[on] = (0.0, ahead)
        if on not in near:
            on = min(near, key=lambda k: float(near[k][0])) if near else OWN
        at = int(near[on][1]) if on != OWN else -1
        run = _Run(on, point, np.array([at], dtype=np.intp))
        if runs and runs[-1].on == on and (on == OWN or abs(at - last) <= 2.0 / SPACING):
            run = _with(runs.pop(), run)
        runs.append(run)
    return runs


def _ahead(there: EdgeCurve, curve: EdgeCurve, point: int, last: int) -> int:
    """Return where a point of a drive is on the curve that it follows, just ahead of the last one; -1: off its lane."""
    at = np.arange(last, min(last + round(1.0 / SPACING), len(there)), dtype=np.intp)
    best = at[np.argmin(np.hypot(there.x[at] - curve.x[point], there.y[at] - curve.y[point]))]
    is_past = there is not curve or point - best > PAST / SPACING
    return int(_on_lane(there, curve, best, point)[1]) if is_past else -1


def _features(curve: EdgeCurve) -> Array:
    turned = (TURN_SCALE * np.cos(curve.yaw), TURN_SCALE * np.sin(curve.yaw))
    return np.stack([curve.x, curve.y, *turned], axis=-1)


def _alongside(there: EdgeCurve, curve: EdgeCurve) -> tuple[Array, Indices]:
    """Return the distance of each point of a curve from another one, and the index there, -1: not on its lane."""
    return _on_lane(there, curve, _nearest(_features(there), _features(curve)), np.arange(len(curve)))


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


def _alongside_itself(curve: EdgeCurve) -> tuple[Array, Indices]:
    """The same of a curve and what it did at least PAST m before."""
    off, found = np.full(len(curve), np.inf), np.full(len(curve), -1, dtype=np.intp)
    features, past, block = _features(curve), round(PAST / SPACING), round(5.0 / SPACING)
    for begin in range(past + 1, len(curve), block):
        points = np.arange(begin, min(begin + block, len(curve)))
        at = _nearest(features[: begin - past], features[points])
        off[points], found[points] = _on_lane(curve, curve, at, points)
    return off, found


def _tidy(strands: Sequence[_Strand], runs: list[_Run], curve: EdgeCurve) -> list[_Run]:
    """Close gaps between runs along the same curve, drop short ones, join neighbours."""
    inner = (_without_gap(*three) for three in zip(runs, runs[1:], runs[2:], strict=False))
    closed = [*runs[:1], *inner, *runs[1:][-1:]]
    kept = [
        replace(run, on=OWN)
        if run.on != OWN and run.count < MIN_SHARED / SPACING and run.first > 0 and run.last < len(curve) - 1
        else run
        for run in _joined(closed)
    ]
    whole = _joined(kept)
    for end in (0, -1):
        if len(whole) > 1 and whole[end].on == OWN and whole[end].count < STUB / SPACING:
            del whole[end]
    return _with_changes(strands, whole)


def _without_gap(before: _Run, run: _Run, after: _Run) -> _Run:
    """Return a short run of its own as one along the curve that it leaves and comes back to."""
    gone = int(after.at[0]) - int(before.at[-1])
    is_gap = run.on == OWN and before.on == after.on != OWN
    if is_gap and run.count <= MAX_APART / SPACING and abs(gone - run.count) <= 2.0 / SPACING:
        between_them = np.linspace(before.at[-1], after.at[0], run.count + 2)[1:-1]
        return _Run(before.on, run.first, between_them.astype(np.intp))
    return run


def _with(run: _Run, following: _Run) -> _Run:
    return replace(run, at=np.concatenate([run.at, following.at]))


def _joined(runs: Iterable[_Run]) -> list[_Run]:
    joined: list[_Run] = []
    for run in runs:
        last = joined[-1] if joined else run
        if joined and last.on == run.on and (run.on == OWN or 0 <= run.at[0] - last.at[-1] <= 2.0 / SPACING):
            run = _with(joined.pop(), run)
        joined.append(run)
    return joined


def _with_changes(strands: Sequence[_Strand], runs: list[_Run]) -> list[_Run]:
    """Put a curve of its own between runs that follow each other on curves that are not connected: a change of lane."""
    half = round(MIN_SHARED / SPACING)
    result: list[_Run] = []
    for run in runs:
        last = result[-1] if result else run
        if result and OWN not in (last.on, run.on) and not _are_connected(strands, last, run):
            before, after = min(half, last.count - 1), min(half, run.count - 1)
            result[-1] = replace(last, at=last.at[: last.count - before])
            result.append(_Run(OWN, last.last + 1 - before, np.full(before + after, -1, dtype=np.intp)))
            run = replace(run, first=run.first + after, at=run.at[after:])
        result.append(run)
    return result


def _are_connected(strands: Sequence[_Strand], last: _Run, run: _Run) -> bool:
    """Whether the curve of one run ends on that of the other, or begins there, about where the drive changes over."""
    if HERE in (last.on, run.on):
        return False
    near = (BLEND + 2.0) / SPACING
    end, begin = strands[last.on].end, strands[run.on].begin
    is_end = end is not None and end.strand == run.on and abs(int(run.at[0]) - end.at) <= near
    is_begin = begin is not None and begin.strand == last.on and abs(int(last.at[-1]) - begin.at) <= near
    return (is_end and len(strands[last.on].curve) - int(last.at[-1]) <= near) or (is_begin and int(run.at[0]) <= near)


# --- branches
def _anchor(
    strands: Sequence[_Strand], curve: EdgeCurve, runs: Sequence[_Run], index: int, side: int
) -> tuple[int, _Anchor | None]:
    """Return where a run of its own begins (-1) or ends (1): on the drive, and on the curve there; None: on none."""
    run, near = runs[index], index + side
    if run.on != OWN or not 0 <= near < len(runs):
        return run.first if side < 0 else run.last, None
    other, window = runs[near], round(BLEND / SPACING)
    share = (other.count + 1) // 2 if 0 <= near + side < len(runs) else other.count
    missing = max(0, window - run.count)  # a short one begins sooner and ends later, so that there is room to blend
    late = max(1, other.count - missing)
    offsets = np.arange(max(0, late - min(window, share)), late)
    return _best(strands, curve, other, offsets if side < 0 else other.count - 1 - offsets[::-1], is_late=side < 0)


def _best(
    strands: Sequence[_Strand], curve: EdgeCurve, run: _Run, offsets: Indices, *, is_late: bool
) -> tuple[int, _Anchor]:
    """Return the point of the drive, and that of the curve, where both are most alike in pose and curvature."""
    there = curve if run.on == HERE else strands[run.on].curve
    points, at = run.first + offsets, run.at[offsets]
    off, turned = _apart(there, curve, at, points)
    cost = off + 3.0 * turned + 4.0 * np.abs(there.bend[at] - curve.bend[points])
    near = np.flatnonzero(cost <= cost.min() + ALIKE)
    best = int(near[-1] if is_late else near[0])
    found = int(at[best])
    end = 0 if found <= SNAP else len(there) - 1 if found >= len(there) - 1 - SNAP and run.on != HERE else found
    return int(points[best]), _Anchor(run.on, end)


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
def _cut(strands: Sequence[_Strand], map_id: str) -> Network:
    """Return the network of curves that are cut at their branches; nodes that nothing branches at are left out."""
    numbers: dict[_Anchor, int] = {}

    def node(place: _Anchor) -> int:
        item = strands[place.strand]
        anchor = item.begin if place.at == 0 else item.end if place.at == len(item.curve) - 1 else None
        return numbers.setdefault(place, len(numbers)) if anchor in (None, place) else node(anchor)

    edges: dict[int, RouteEdge] = {}
    for index, strand in enumerate(strands):
        changes = np.flatnonzero(np.any(strand.ways[:, 1:] != strand.ways[:, :-1], axis=0)) + 1
        for first, last in pairwise(sorted({0, len(strand.curve) - 1, *strand.cuts, *changes.tolist()})):
            ends = node(_Anchor(index, first)), node(_Anchor(index, last))
            may = strand.ways[:, (first + last) // 2].tolist()
            edges[len(edges)] = RouteEdge(len(edges), *ends, strand.curve.between(first, last), *may)
    home = node(_Anchor(0, 0))
    nodes = {number: strands[at.strand].curve.point(at.at) for at, number in numbers.items()}
    return _renumbered(_dissolved(Network(nodes, edges, {"home": home}, map_id)))


def _dissolved(network: Network) -> Network:
    """Join edges at nodes where there is only one way on, driven alike, unless the node is a place."""
    edges, nodes = dict(network.edges), dict(network.nodes)
    for number in list(nodes):
        before = [edge for edge in edges.values() if edge.end == number]
        after = [edge for edge in edges.values() if edge.start == number]
        if len(before) != 1 or len(after) != 1 or network.name_of(number) or before[0] is after[0]:
            continue
        a, b = before[0], after[0]
        if (a.is_forward, a.is_reverse) != (b.is_forward, b.is_reverse):
            continue
        x, y, yaw, speed = np.concatenate([a.curve.columns, b.curve.columns[:, 1:]], axis=1)
        edges[a.id] = replace(a, end=b.end, curve=EdgeCurve(x, y, np.unwrap(yaw), speed))
        del edges[b.id], nodes[number]
    return replace(network, nodes=nodes, edges=edges)


def _renumbered(network: Network) -> Network:
    """Number nodes, then edges, from 1: no number stands for both, as Nav2's Route Server wants it."""
    names = {old: new for new, old in enumerate(network.nodes, 1)}
    nodes = {names[node]: pose for node, pose in network.nodes.items()}
    edges = {
        number: replace(edge, id=number, start=names[edge.start], end=names[edge.end])
        for number, edge in enumerate(network.edges.values(), len(names) + 1)
    }
    return replace(network, nodes=nodes, edges=edges, places={k: names[v] for k, v in network.places.items()})
