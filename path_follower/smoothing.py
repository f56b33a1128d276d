"""A smooth curve through noisy, uneven or coarse points, with the heading and curvature that a car needs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from path_follower.constants import MAX_BEND, MIN_SPACING, SPACING
from path_follower.params import PathParams
from sphere_nav.geometry.arrays import Array, arc_lengths

THIRD_DIFFERENCE = (-1.0, 3.0, -3.0, 1.0)


class Curve(NamedTuple):
    """Equally spaced points (N,) of one segment; `tangent` is unwrapped, `bend` is d tangent / d way in 1/m."""

    x: Array
    y: Array
    tangent: Array
    bend: Array
    way: Array


def smooth_curve(points: Array, params: PathParams) -> Curve:
    """Return the smooth curve along points (N, 2), N >= 2, that are all different from their neighbours.

    Steps: dense points are averaged over `MIN_SPACING`; a spline gives equal spacing; a low-pass filter removes
    bends below `smoothing_length`; a spline through the result gives tangent and curvature.
    """
    coarse = _average(points)
    even = _resample(coarse)
    if params.smoothing_length > 0:
        step = float(np.median(np.linalg.norm(np.diff(even, axis=0), axis=-1)))
        even = _filter(even, cutoff_weight(params.smoothing_length, step))
    return _measure(even)


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
    even = _even(way)
    if len(points) < 4 or _largest_bend(points) > MAX_BEND:
        return np.column_stack([np.interp(even, way, points[:, axis]) for axis in (0, 1)])
    return _spline(way, points)(even)


def _even(way: Array) -> Array:
    """Return equal steps of a way, of about `SPACING` m, three or more."""
    return np.linspace(0.0, way[-1], max(int(np.ceil(way[-1] / SPACING)), 3) + 1)


def _largest_bend(points: Array) -> float:
    directions = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    return float(np.abs(np.diff(directions)).max())


def _spline(way: Array, points: Array) -> Any:
    kind = "not-a-knot" if len(points) > 3 else "natural"
    from scipy.interpolate import CubicSpline  # a second; the process of the control loop smooths nothing

    return CubicSpline(way, points, bc_type=kind)


def _filter(points: Array, weight: float) -> Array:
    """Minimise |p - q|^2 + weight |third difference of q|^2."""
    count = len(points)
    if count < 5:
        return points
    from scipy.sparse import diags_array, eye_array  # these, too
    from scipy.sparse.linalg import spsolve

    D = diags_array(THIRD_DIFFERENCE, offsets=range(4), shape=(count - 3, count))
    return np.asarray(spsolve((eye_array(count) + weight * D.T @ D).tocsc(), points))


def _measure(points: Array) -> Curve:
    lengths = np.hypot(*np.diff(points, axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(np.maximum(lengths, 1e-9))])
    spline = _spline(way, points)
    even = _even(way)
    position, first, second = spline(even), spline(even, 1), spline(even, 2)
    speed = np.maximum(np.hypot(*first.T), 1e-9)
    bend = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    tangent = np.unwrap(np.arctan2(first[:, 1], first[:, 0]))
    return Curve(position[:, 0], position[:, 1], tangent, bend, arc_lengths(position))
