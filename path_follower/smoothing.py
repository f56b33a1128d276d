"""A smooth curve through noisy, uneven or coarse points, with the heading and curvature that a car needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from path_follower.constants import MAX_BEND, MIN_SPACING, SPACING
from path_follower.params import PathParams
from path_follower.path import Pose2
from sphere_nav.geometry.arrays import Array, arc_lengths

THIRD_DIFFERENCE = (-1.0, 3.0, -3.0, 1.0)


@dataclass(frozen=True, eq=False)
class Curve:
    """Points (N,), N >= 2, in the order in which the vehicle heads: m, m, rad unwrapped, m/s (NaN: unknown)."""

    x: Array
    y: Array
    yaw: Array
    speed: Array

    def __len__(self) -> int:
        return len(self.x)

    @cached_property
    def arc(self) -> Array:
        """Arc length (N,) from the first point, in m."""
        return arc_lengths(np.column_stack([self.x, self.y]))

    @property
    def columns(self) -> Array:
        """Its points as x, y, yaw, speed (4, N)."""
        return np.stack([self.x, self.y, self.yaw, self.speed])

    @property
    def length(self) -> float:
        """Arc length of the last point, in m."""
        return float(self.arc[-1])

    @property
    def bend(self) -> Array:
        """Curvature (N,) in 1/m, positive to the left."""
        return np.gradient(self.yaw, np.maximum(self.arc, 1e-9 * np.arange(len(self))))

    def pose(self, s: float) -> Pose2:
        """Return the pose at an arc length."""
        return Pose2(*(float(np.interp(s, self.arc, values)) for values in (self.x, self.y, self.yaw)))

    def point(self, at: int) -> Pose2:
        """Return one of its points."""
        return Pose2(float(self.x[at]), float(self.y[at]), float(self.yaw[at]))

    def part(self, first: float, last: float) -> Curve:
        """Return the curve between two arc lengths, with points there; first <= last."""
        inside = (self.arc > first + 1e-6) & (self.arc < last - 1e-6)
        s = np.concatenate([[first], self.arc[inside], [last]])
        return Curve(*(np.interp(s, self.arc, values) for values in self.columns))

    def turned(self) -> Curve:
        """Return the curve from its end to its begin."""
        return Curve(self.x[::-1], self.y[::-1], self.yaw[::-1] + np.pi, self.speed[::-1])

    def between(self, first: int, last: int) -> Curve:
        """Return a copy of the curve from one of its points to another one."""
        return Curve(*self.columns[:, first : last + 1].copy())


@dataclass(frozen=True, eq=False)
class TaughtDrive:
    """A taught curve, driven forward (1) or backwards (-1)."""

    curve: Curve
    direction: int = 1


def smooth_curve(points: Array, params: PathParams) -> Curve:
    """Return the smooth curve along points (N, 2), N >= 2, that are not all at one place; it heads as they go on.

    Steps: dense points are averaged over `MIN_SPACING`; a spline gives equal spacing; a low-pass filter removes
    bends below `smoothing_length`.
    """
    even = _resample(_average(points))
    if params.smoothing_length > 0:
        step = float(np.median(np.linalg.norm(np.diff(even, axis=0), axis=-1)))
        even = _filter(even, cutoff_weight(params.smoothing_length, step))
    x, y = even.T
    yaw = np.unwrap(np.arctan2(np.gradient(y, edge_order=2), np.gradient(x, edge_order=2)))
    return Curve(x, y, yaw, np.full(len(x), np.nan))


def cutoff_weight(wavelength: float, spacing: float) -> float:
    """Return the weight of squared third differences that halves bends of this wavelength, and removes shorter ones.

    The filter has the gain 1 / (1 + weight (2 sin(pi spacing / wavelength))^6); it keeps parabolas, so that steady
    turns and slow changes of curvature pass unbiased.
    """
    return float((2.0 * np.sin(np.pi * spacing / max(wavelength, 2.0 * spacing))) ** -6)


def _average(points: Array) -> Array:
    """Average runs of points (N, 2) that stay near the first of the run; both ends stay as they are."""
    bins, run = [], [points[0]]
    for point in points[1:]:
        if np.hypot(*(point - run[0])) >= MIN_SPACING:
            bins.append(np.mean(run, axis=0))
            run = []
        run.append(point)
    bins.append(np.mean(run, axis=0))
    inner = [p for p in bins[1:-1] if min(np.hypot(*(p - points[0])), np.hypot(*(p - points[-1]))) > MIN_SPACING / 2]
    return np.array([points[0], *inner, points[-1]])


def _resample(points: Array) -> Array:
    points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-9)]
    way = arc_lengths(points)
    even = np.linspace(0.0, way[-1], max(int(np.ceil(way[-1] / SPACING)), 3) + 1)  # three steps or more
    if len(points) < 4 or _largest_bend(points) > MAX_BEND:
        return np.column_stack([np.interp(even, way, points[:, axis]) for axis in (0, 1)])
    from scipy.interpolate import CubicSpline  # a second; the process of the control loop smooths nothing

    return np.asarray(CubicSpline(way, points)(even))


def _largest_bend(points: Array) -> float:
    directions = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    return float(np.abs(np.diff(directions)).max())


def _filter(points: Array, weight: float) -> Array:
    """Minimise |p - q|^2 + weight |third difference of q|^2."""
    count = len(points)
    if count < 5:
        return points
    from scipy.sparse import diags_array, eye_array  # these, too
    from scipy.sparse.linalg import spsolve

    D = diags_array(THIRD_DIFFERENCE, offsets=range(4), shape=(count - 3, count))
    return np.asarray(spsolve((eye_array(count) + weight * D.T @ D).tocsc(), points))
