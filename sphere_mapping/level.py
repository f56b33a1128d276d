"""Which way is up where a map begins: by an IMU, by the ground that the first sphere sees, else by the mounting.

The frame of a map is `base_link` at its first sphere, turned so that z is up (REP 103, REP 105): x keeps its heading.
An accelerometer at rest measures nothing but gravity. In motion the orientation of an IMU that has one serves. Without
any, the ground is the lowest plane of the first sphere; it corrects the mounting by what it can prove, no more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sphere_mapping.constants import (
    GRAVITY,
    GROUND_BELOW,
    GROUND_FLOOR_RAD,
    GROUND_POINTS,
    GROUND_SHARE,
    GROUND_TOLERANCE,
    GROUND_TRIALS,
    INDEPENDENT,
    MIN_STILL,
    NUM_FITS,
    STEEP,
    STILL_DRIFT,
    STILL_FORCE,
    STILL_RATE,
)
from sphere_nav.estimation.least_squares import gate
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Flags

BY_REST, BY_ORIENTATION = "gravity (IMU at rest)", "gravity (orientation of the IMU)"
BY_GROUND, BY_MOUNTING = "the ground of the first sphere", "the mounting"
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Upright:
    """Up (3,) in axes of the base, a unit vector, and what says so."""

    up_base: Array
    source: str = BY_MOUNTING

    @property
    def tilt_rad(self) -> float:
        """How far the base leans."""
        return float(np.arccos(np.clip(self.up_base[2], -1.0, 1.0)))

    @property
    def T_map_base(self) -> SE3:
        """The base where the map begins: at its origin, level, heading along x."""
        x, y, up = np.eye(3)[0], np.eye(3)[1], self.up_base
        ahead = x - (x @ up) * up if abs(x @ up) < STEEP else np.cross(y, up)
        ahead /= np.linalg.norm(ahead)
        return SE3.from_parts(np.stack([ahead, np.cross(up, ahead), up]), np.zeros(3))


@dataclass(frozen=True, eq=False)
class ImuSample:
    """Specific force (3,) m/s^2 and angular rate (3,) rad/s; up (3,) by its orientation, None where it has none.

    Axes of the IMU.
    """

    stamp_ns: int
    force: Array
    rate: Array
    up: Array | None = None


def find_gravity(samples: Sequence[ImuSample], R_base_imu: Array) -> Upright | None:
    """Return the level by samples around one instant; None where they are too few, or in motion without orientation."""
    if len(samples) >= MIN_STILL:
        force, rate = (np.stack([getattr(one, name) for one in samples]) for name in ("force", "rate"))
        mean, halves = force.mean(axis=0), [half.mean(axis=0) for half in np.array_split(force, 2)]
        is_gravity = abs(np.linalg.norm(mean) - GRAVITY) < STILL_FORCE and np.all(force.std(axis=0) < STILL_FORCE)
        is_steady = np.linalg.norm(halves[1] - halves[0]) < STILL_DRIFT
        if is_gravity and is_steady and np.sqrt(np.mean(np.sum(rate**2, axis=1))) < STILL_RATE:
            return Upright(_unit(R_base_imu @ mean), BY_REST)
    ups = [one.up for one in samples if one.up is not None]
    return Upright(_unit(R_base_imu @ np.mean(ups, axis=0)), BY_ORIENTATION) if ups else None


def find_ground(points_base: Array, eye_base: Array, max_tilt_rad: float) -> Upright | None:
    """Return the level by the lowest plane of points (N, 3) m seen from `eye_base` (3,), axes of the base.

    None where there is no such plane, or where it is as level as it can tell.
    """
    step = max(1, len(points_base) // GROUND_POINTS)
    points = points_base[::step].astype(np.float64)
    if len(points) < GROUND_POINTS // 10:
        return None
    range_m = np.linalg.norm(points - eye_base, axis=1)
    tolerance = GROUND_TOLERANCE[0] + GROUND_TOLERANCE[1] * range_m
    is_near = _find_lowest_plane(points, eye_base, tolerance, max_tilt_rad)
    for _ in range(NUM_FITS):
        if is_near.sum() < GROUND_SHARE * len(points):
            return None
        normal, offset, spread = _fit_plane(points[is_near], 1.0 / tolerance[is_near])
        off = points @ normal - offset
        is_near = np.abs(off) < tolerance
    sigma_m = float(np.sqrt(np.mean(off[is_near] ** 2)))
    level = Upright(normal, BY_GROUND)
    sigma = GROUND_FLOOR_RAD + sigma_m / spread / np.sqrt(max(is_near.sum() / INDEPENDENT, 1.0))
    return level if gate(2) * sigma**2 < level.tilt_rad**2 and level.tilt_rad <= max_tilt_rad else None


def _find_lowest_plane(points: Array, eye: Array, tolerance: Array, max_tilt_rad: float) -> Flags:
    """Return which points (N,) bool lie on the largest plane that leans no more, with hardly a point below it."""
    rng, best = np.random.default_rng(0), np.zeros(len(points), np.bool_)
    for _ in range(GROUND_TRIALS):
        three = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(three[1] - three[0], three[2] - three[0])
        length = np.linalg.norm(normal)
        if length < 1e-9 or abs(normal[2]) < np.cos(max_tilt_rad) * length:
            continue
        normal *= np.sign(normal[2]) / length
        off = (points - three[0]) @ normal
        is_near = np.abs(off) < tolerance
        is_lowest = np.mean(off < -3.0 * tolerance) < GROUND_BELOW and (eye - three[0]) @ normal > 0.0
        if is_lowest and is_near.sum() > best.sum():
            best = is_near
    return best


def _fit_plane(points: Array, weights: Array) -> tuple[Array, float, float]:
    """Return the normal (3,) up, its offset in m, and the smaller spread of the points in the plane in m."""
    share = weights**2 / np.sum(weights**2)
    middle = share @ points
    variances, axes = np.linalg.eigh(((points - middle) * share[:, None]).T @ (points - middle))
    normal = axes[:, 0] * np.sign(axes[2, 0])
    return normal, float(normal @ middle), float(np.sqrt(variances[1]))


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
