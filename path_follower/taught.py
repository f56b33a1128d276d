"""From the poses of a taught drive, or any list of points, to the reference trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from path_follower.constants import (
    CUSP_HYSTERESIS,
    MAX_GAP,
    MAX_LENGTH,
    MAX_POINTS,
    MAX_SIDEWAYS,
    MIN_LENGTH,
    MIN_TAUGHT,
)
from path_follower.law import speed_limits, speed_profile
from path_follower.params import FollowerParams
from path_follower.path import ReferencePath, Segment, turned_by
from path_follower.smoothing import Curve, TaughtDrive, smooth_curve
from sphere_nav.geometry.arrays import Array, Integers, arc_lengths


class Given(NamedTuple):
    """What a path is made of: points (N, 2) m in order of driving, headings (N,) rad and speeds (N,) m/s where known.

    Headings say where the vehicle drove backwards; without them everything is forward. Speeds are upper bounds, NaN
    where unknown. `map_id`: of the map it was taught in; `frame`: that of the points, where it is told.
    """

    points: Array
    yaw: Array | None = None
    speed: Array | None = None
    map_id: str = ""
    frame: str = ""


def make_path(given: Given, params: FollowerParams) -> ReferencePath:
    """Make the trajectory; ValueError for what cannot be driven."""
    return replace(_join(make_drives(given, params), params), map_id=given.map_id).at_cruise(params.speed.cruise)


def make_drives(given: Given, params: FollowerParams) -> list[TaughtDrive]:
    """Return smooth curves, one for each direction in turn; ValueError for what cannot be driven."""
    xy = given.points
    headings = _check(xy, given.yaw)
    speeds = np.full(len(xy), np.nan) if given.speed is None else np.abs(given.speed)
    drives = []
    for first, last, direction in _split(xy, headings) if headings is not None else [(0, len(xy) - 1, 1)]:
        own = slice(first, last + 1)
        curve = smooth_curve(xy[own], params.path)
        driven = arc_lengths(xy[own])
        way = driven / max(driven[-1], 1e-9) * curve.length
        if headings is not None:
            _check_heading(headings[own], way, curve, direction)
        if (known := np.isfinite(speeds[own])).any():
            curve = replace(curve, speed=np.interp(curve.arc, way[known], speeds[own][known]))
        drives.append(TaughtDrive(curve if direction > 0 else curve.turned(), direction))
    return drives


def taught_speeds(points: Array, stamps_ns: Integers) -> Array:
    """Return the speed (N,) in m/s at points (N, 2) of a drive, over 0.5 m to both sides: noise does not count."""
    way = 0.5
    driven = arc_lengths(points)
    before = np.maximum(np.searchsorted(driven, driven - way, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(driven, driven + way), len(driven) - 1)
    seconds = np.maximum((stamps_ns[after] - stamps_ns[before]) / 1e9, 1e-3)
    return np.hypot(*(points[after] - points[before]).T) / seconds


def told_headings(xy: Array, turns: Array) -> Array | None:
    """Return headings (N,) of quaternions (N, 4) at points (N, 2); None where orientations were left at their default.

    That is no turn, or nothing but zeros; planners fill in those of the start and of the goal, if any. A way forth and
    back is no planner's.
    """
    x, y, z, w = turns.T
    yaw: Array = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    told = np.any(turns[:, :3] != 0.0, axis=1)
    is_told = np.any(told[1:-1] if len(yaw) > 2 else told[:1])
    return yaw if is_told or len(_split(xy, yaw)) > 1 else None


def _check(xy: Array, headings: Array | None) -> Array | None:
    """Return the headings, None where they are not those of the way; ValueError for points that are none."""
    if not 2 <= len(xy) <= MAX_POINTS:
        raise ValueError(f"path: expected 2 to {MAX_POINTS} points (x, y), found {len(xy)}")
    table = xy if headings is None else np.column_stack([xy, headings])
    for bad in np.flatnonzero(~np.isfinite(table).all(axis=1)):
        raise ValueError(f"path: point {bad}: expected finite numbers, found {table[bad].tolist()}")
    gaps = np.hypot(*np.diff(xy, axis=0).T)
    if gaps.max() > MAX_GAP:
        far = int(np.argmax(gaps)) + 1
        raise ValueError(f"path: point {far}: expected at most {MAX_GAP:.0f} m from the last, found {gaps.max():.4g} m")
    length = float(np.sum(gaps))
    if not MIN_LENGTH <= length <= MAX_LENGTH:
        raise ValueError(f"path: expected a length of {MIN_LENGTH} to {MAX_LENGTH:.0f} m, found {length:.3g} m")
    if headings is None:
        return None
    inner = headings[len(xy) > 3 : max(2, len(xy) - 1)]  # not of start and goal
    is_same = np.ptp(inner) < 1e-6 and _is_across(xy, float(inner[0]))  # everywhere, and not that of the way
    return None if is_same else headings


def _is_across(xy: Array, yaw: float) -> bool:
    """Return whether a constant heading cannot be that of a car on these points, on a part of the way."""
    steps = np.diff(xy, axis=0)
    length = np.hypot(*steps.T)
    along = np.abs(steps @ [np.cos(yaw), np.sin(yaw)])
    return bool(np.sum(length[along < np.cos(MAX_SIDEWAYS) * length]) > 0.02 * length.sum())


def _split(xy: Array, yaw: Array) -> list[tuple[int, int, int]]:
    """Return (first, last, direction) of runs in one direction: between the turning points of the way made good.

    The way made good is the sum of steps along the heading; noise telescopes away, and a turning point counts once
    the way back exceeds the hysteresis.
    """
    steps = np.diff(xy, axis=0)
    middle = yaw[:-1] + 0.5 * ((np.diff(yaw) + np.pi) % (2 * np.pi) - np.pi)
    good = np.concatenate([[0.0], np.cumsum(steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle))])
    from scipy.signal import find_peaks  # a second; the process of the control loop splits nothing

    turns = []
    for direction in (1, -1):
        _, found = find_peaks(direction * good, prominence=CUSP_HYSTERESIS, plateau_size=0)
        turns += [(int(first), direction) for first in found["left_edges"]]
    turns.sort()
    is_back = turns[-1][1] > 0 if turns else np.max(np.maximum.accumulate(good) - good) > CUSP_HYSTERESIS
    ends = [*turns, (len(xy) - 1, -1 if is_back else 1)]
    firsts = [0, *(end for end, _ in ends[:-1])]
    return [(first, last, sign) for first, (last, sign) in zip(firsts, ends, strict=True)]


def _check_heading(yaw: Array, way: Array, curve: Curve, direction: int) -> None:
    tangent = curve.yaw[np.searchsorted(curve.arc, way)] + (np.pi if direction < 0 else 0.0)
    off = turned_by(yaw, tangent)
    worst = int(np.argmax(off))
    if np.median(off) > MAX_SIDEWAYS:
        found = f"{np.degrees(np.median(off)):.0f} deg off, {np.degrees(off[worst]):.0f} at point {worst}"
        raise ValueError(f"path: yaw: expected along the way, as a car drives, found {found}")


def _join(drives: Sequence[TaughtDrive], params: FollowerParams) -> ReferencePath:
    """Return the trajectory of drives one after the other."""
    vehicle = params.vehicle
    unhurried = replace(params.speed, cruise=vehicle.max_speed)
    segments: list[Segment] = []
    columns: list[tuple[Array, ...]] = []
    begin, start = 0, 0.0
    for drive in drives:
        direction = drive.direction
        (x, y, yaw, taught), bend = drive.curve.columns[:, ::direction], drive.curve.bend[::direction]
        way = arc_lengths(np.column_stack([x, y]))
        limits = speed_limits(way, bend, unhurried, vehicle)
        if params.speed.is_as_taught:
            limits = np.fmin(limits, np.maximum(taught, MIN_TAUGHT))
        columns.append((x, y, yaw, bend, start + way, direction * speed_profile(way, limits, vehicle)))
        segments.append(Segment(begin, begin + len(way) - 1, direction))
        begin, start = begin + len(way), start + float(way[-1])
    x, y, yaw, bend, way, speed = (np.concatenate(column) for column in zip(*columns, strict=True))
    return ReferencePath(x, y, yaw, bend, way, speed, tuple(segments))
