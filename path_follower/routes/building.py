"""From drives to a network: what two drives share is one edge; where they part or meet is a branch.

Drives are taken one after the other. Each of its points is compared, in position and heading, with the curves that are
there already, and with what the drive itself did before. Runs alongside keep the curve that was there first. What is
left becomes a curve of its own, which begins and ends on the other ones: at the branch it has their pose and curvature
and goes over to what was driven within some metres. Each step from point to point that a drive made is a link; where
links branch, or are driven in other directions, edges begin and end.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
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
from path_follower.routes.network import Indices, Network, RouteEdge
from path_follower.smoothing import Curve
from path_follower.smoothing import TaughtDrive as TaughtDrive
from sphere_nav.geometry.arrays import Array

HERE, OWN = -1, -2  # curves that a drive may be on: what it did before (the last of them), and none that was there


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
    """A curve of the network before it is cut, and its points: its own but at ends that lie on another curve."""

    curve: Curve
    places: list[_Place]


_Links = dict[tuple[_Place, _Place], set[int]]  # from a point to the next one: in which directions it was driven
_Neighbours = dict[_Place, dict[_Place, bool]]  # of each point: whether they are ahead of it, or behind


def build_network(drives: Sequence[TaughtDrive], map_id: str = "") -> Network:
    """Return the network of drives; the first of them begins at the place `home`."""
    if not drives:
        raise ValueError("network: expected drives, found none")
    strands: list[_Strand] = []
    links: _Links = {}
    for drive in drives:
        _add_drive(strands, links, drive)
    return _cut(strands, links, map_id)


def _add_drive(strands: list[_Strand], links: _Links, drive: TaughtDrive) -> None:
    """Add what a drive does not share as curves of their own, and all steps that it made."""
    curve = drive.curve
    on, at = _alongside(strands, curve)
    runs = _with_changes(strands, at, _tidy(on, at))
    kept = slice(runs[0].first, runs[-1].last + 1)
    at[on == HERE] = np.maximum(at[on == HERE], kept.start)
    places = [_Place(*place) for place in zip(on.tolist(), at.tolist(), strict=True)]  # in the network, of each point
    for index, run in enumerate(runs):
        if run.on == OWN:
            (first, begin), (last, end) = (_branch(strands, curve, at, runs, index, side) for side in (-1, 1))
            own = [_Place(len(strands), point) for point in range(last - first + 1)]
            strand = _Strand(curve.between(first, last), own.copy())
            places[first : last + 1] = own
            strands.append(strand)
            span = curve.between(first, last).length / (1.0 if begin is None or end is None else 2.0)
            for joint, here in ((begin, 0), (end, -1)):
                if joint is not None:
                    place = strand.places[here] = _settled(strands, places, joint)
                    strand.curve = _blended(strand.curve, here, strands[place.strand].curve, place.at, min(BLEND, span))
    near, own = _neighbours(strands), [_settled(strands, places, place) for place in places[kept]]
    for place, speed in zip(own, curve.speed[kept], strict=True):
        known = strands[place.strand].curve.speed
        known[place.at] = np.fmax(known[place.at], speed)
    for left, met in pairwise(own):
        for a, b in pairwise(_way(near, left, met)):
            links.setdefault((a, b) if near[a][b] else (b, a), set()).add(drive.direction)


def _settled(strands: Sequence[_Strand], places: Sequence[_Place], place: _Place) -> _Place:
    """Return a place of the network for one on a curve, or on what the drive itself did before."""
    while place.strand == HERE:
        place = places[place.at]
    return strands[place.strand].places[place.at]


def _neighbours(strands: Sequence[_Strand]) -> _Neighbours:
    near: _Neighbours = defaultdict(dict)
    for left, met in (step for strand in strands for step in pairwise(strand.places)):
        near[left][met], near[met][left] = True, False
    return near


def _way(near: _Neighbours, left: _Place, met: _Place) -> list[_Place]:
    """Return the places from one to another one, the shortest way, ahead or back; none where there is none nearby."""
    ways, seen = deque([[left]]), {left}
    while ways and len(way := ways.popleft()) < 2.0 * (BLEND + 2.0) / SPACING:
        if way[-1] == met:
            return way
        ways += [[*way, place] for place in near[way[-1]] if place not in seen]
        seen.update(near[way[-1]])
    return []


# --- alongside
def _alongside(strands: Sequence[_Strand], curve: Curve) -> tuple[Indices, Indices]:
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


def _ahead(there: Curve, curve: Curve, point: int, last: int) -> int:
    """Return where a point of a drive is on the curve that it follows, just ahead of the last one; -1: off its lane."""
    at = np.arange(last, min(last + round(1.0 / SPACING), len(there)), dtype=np.intp)
    best = at[np.argmin(np.hypot(there.x[at] - curve.x[point], there.y[at] - curve.y[point]))]
    is_past = there is not curve or point - best > PAST / SPACING
    return int(_on_lane(there, curve, best, point)[1]) if is_past else -1


def _near(there: Curve, curve: Curve) -> tuple[Array, Indices]:
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


def _features(curve: Curve) -> Array:
    turned = (TURN_SCALE * np.cos(curve.yaw), TURN_SCALE * np.sin(curve.yaw))
    return np.stack([curve.x, curve.y, *turned], axis=-1)


def _nearest(known: Array, features: Array) -> Indices:
    """Return which of known features (N, 4) is the nearest to each of others (M, 4); any where none is near."""
    reach = math.hypot(LANE, TURN_SCALE * SAME_HEADING)
    _, at = cKDTree(known).query(features, distance_upper_bound=reach)
    return np.minimum(at, len(known) - 1)


def _on_lane(there: Curve, curve: Curve, at: Indices, points: Indices | int) -> tuple[Array, Indices]:
    off, turned = _apart(there, curve, at, points)
    is_near = (off <= LANE) & (turned <= SAME_HEADING)
    return np.where(is_near, off, np.inf), np.where(is_near, at, -1)


def _apart(there: Curve, curve: Curve, at: Indices, points: Indices | int) -> tuple[Array, Array]:
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
    half, near = round(MIN_SHARED / SPACING), _neighbours(strands)
    result = runs[:1]
    for run in runs[1:]:
        last = result[-1]
        ends = [(last.on, int(at[last.last])), (run.on, int(at[run.first]))]
        is_known = min(last.on, run.on) >= 0  # else on a curve of its own, or on what it did before
        is_joined = is_known and _way(near, *(strands[on].places[point] for on, point in ends))
        if OWN not in (last.on, run.on) and not is_joined:
            left, met = max(last.first, last.last - half), min(run.last, run.first + half)
            result[-1] = replace(last, last=left)
            result.append(_Run(OWN, left + 1, met - 1))
            run = replace(run, first=met)
        result.append(run)
    return result


# --- branches
def _branch(
    strands: Sequence[_Strand], curve: Curve, at: Indices, runs: Sequence[_Run], index: int, side: int
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


def _most_alike(there: Curve, curve: Curve, at: Indices, points: Indices) -> Indices:
    """Return those of the points of a drive that are most alike, in pose and curvature, to points of a curve."""
    off, turned = _apart(there, curve, at, points)
    cost = off + 3.0 * turned + 4.0 * np.abs(there.bend[at] - curve.bend[points])
    return points[cost <= cost.min() + ALIKE]


def _blended(curve: Curve, here: int, other: Curve, at: int, span: float) -> Curve:
    """Return a curve that begins (`here` is 0) or ends (-1) with the pose and curvature of a point of another one.

    The offset from what was driven fades out over `span` m by the polynomial of fifth degree that has it, its slope and
    its curvature at the branch, and none of them at the other end.
    """
    sign, target = (1.0 if here == 0 else -1.0), other.point(at)
    ahead, left, turn = between(curve.point(here), target)
    slope = sign * math.tan(turn)
    bend = float(other.bend[at] - curve.bend[here])
    way = curve.arc if here == 0 else curve.length - curve.arc
    share = np.minimum(way / max(span, 1e-6), 1.0)
    shift = _fade(share, left, slope * span, bend * span**2)
    along = ahead * _fade(share, 1.0, 0.0, 0.0)
    x = curve.x - shift * np.sin(curve.yaw) + along * np.cos(curve.yaw)
    y = curve.y + shift * np.cos(curve.yaw) + along * np.sin(curve.yaw)
    turned = np.arctan2(np.gradient(y), np.gradient(x))
    turned[here] = target.yaw
    turned = np.where(way < span, curve.yaw + (turned - curve.yaw + np.pi) % (2.0 * np.pi) - np.pi, curve.yaw)
    return Curve(x, y, np.unwrap(turned), curve.speed)


def _fade(u: Array, value: float, slope: float, bend: float) -> Array:
    """Return the polynomial of fifth degree with this value, slope and second derivative at 0, and zero ones at 1."""
    return np.asarray(BPoly.from_derivatives([0.0, 1.0], [[value, slope, bend], [0.0, 0.0, 0.0]])(u))


# --- nodes and edges
def _cut(strands: Sequence[_Strand], links: _Links, map_id: str) -> Network:
    """Return the network: its nodes are where links branch, or are driven otherwise on both sides, and `home`.

    No number stands for a node and for an edge, as Nav2's Route Server wants it.
    """
    home, columns = strands[0].places[0], [strand.curve.columns for strand in strands]
    before, after = defaultdict[_Place, list[_Place]](list), defaultdict[_Place, list[_Place]](list)
    for left, met in links:
        after[left].append(met)
        before[met].append(left)

    def is_node(place: _Place) -> bool:
        come, go = [links[left, place] for left in before[place]], [links[place, met] for met in after[place]]
        return place == home or len(come) != 1 or come != go

    chains: list[list[_Place]] = []
    done: set[tuple[_Place, _Place]] = set()
    for left, met in sorted(links, key=lambda link: not is_node(link[0])):  # a round without any is cut somewhere
        if (left, met) not in done:
            chain = [left, met]
            while not is_node(chain[-1]) and chain[-1] != left:
                chain += after[chain[-1]]
            done.update(pairwise(chain))
            chains.append(chain)
    names: dict[_Place, int] = {}
    for place in (home, *(chain[end] for chain in chains for end in (0, -1))):
        names.setdefault(place, len(names) + 1)
    edges = {}
    for number, chain in enumerate(chains, len(names) + 1):
        x, y, yaw, speed = np.stack([columns[place.strand][:, place.at] for place in chain], axis=1)
        ways = links[chain[0], chain[1]]
        curve = Curve(x, y, np.unwrap(yaw), speed)
        edges[number] = RouteEdge(number, names[chain[0]], names[chain[-1]], curve, 1 in ways, -1 in ways)
    nodes = {name: strands[place.strand].curve.point(place.at) for place, name in names.items()}
    return Network(nodes, edges, {"home": names[home]}, map_id)
