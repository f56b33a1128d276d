"""How the vehicle moved between two images, as odometry says, and how wrong that may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcl_depth.constants import (
    BLIND_SPEED,
    BLIND_TURN_RATE,
    MAX_BLIND_STEP,
    MAX_LEAP,
    MIN_TURN_SIGMA,
)
from mcl_depth.params import MotionParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True)
class Step:
    """Motion (3,) of `level` in its own axes: forward m, left m, yaw rad, and standard deviations (3,) of it."""

    motion: Array
    sigmas: Array
    is_known: bool = True
    jump: float = 0.0  # m that odometry leapt, where it was not believed


def wrap_angle(angle: Array) -> Array:
    """Return angles in rad in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def planar_pose(pose: SE3) -> Array:
    """Return x, y, yaw (3,) of a pose."""
    return np.array([*pose.translation[:2], float(pose.yaw)])


def way_of(motion: Array) -> float:
    """Return the way in m of a motion (3,) or a pose (3,)."""
    return float(np.hypot(motion[0], motion[1]))


def relative_motion(before: Array, after: Array) -> Array:
    """Return the motion (3,) from one planar pose to another in the axes of the first."""
    cosine, sine = np.cos(before[2]), np.sin(before[2])
    dx, dy = after[:2] - before[:2]
    return np.array([cosine * dx + sine * dy, cosine * dy - sine * dx, float(wrap_angle(after[2] - before[2]))])


def compose_planar(poses: Array, motions: Array) -> Array:
    """Return planar poses (N, 3) after motions (N, 3) or (3,), each in the axes of its pose."""
    forward, left, turn = np.moveaxis(np.broadcast_to(motions, poses.shape), -1, 0)
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + cosine * forward - sine * left
    y = poses[:, 1] + sine * forward + cosine * left
    return np.stack([x, y, wrap_angle(poses[:, 2] + turn)], axis=1)


def sample_motion(poses: Array, step: Step, rng: np.random.Generator) -> Array:
    """Return poses (N, 3) after a step, each with an error of its own (algorithm 2, line 6)."""
    return compose_planar(poses, step.motion + step.sigmas * rng.standard_normal(poses.shape))


def odometry_step(motion: Array, seconds: float, params: MotionParams) -> Step:
    """Return what is believed of a motion (3,) by odometry within some seconds; one that leaps is not."""
    way = way_of(motion)
    if not way <= params.max_speed * seconds + MAX_LEAP:
        return blind_step(seconds, jump=way if np.isfinite(way) else 1e9)
    return Step(motion, motion_sigmas(motion, params, params.min_sigma))


def blind_step(seconds: float, jump: float = 0.0) -> Step:
    """Return what is known without odometry, or of one that leapt by `jump` m."""
    way = min(BLIND_SPEED * seconds, MAX_BLIND_STEP)
    turn = min(BLIND_TURN_RATE * seconds, np.pi / 4)
    return Step(np.zeros(3), np.array([way, way, turn]), is_known=False, jump=jump)


def motion_sigmas(motion: Array, params: MotionParams, least: float) -> Array:
    """Return the standard deviations (3,) of a motion (3,) by odometry, those of a position at least so many m."""
    way, turn = way_of(motion), float(motion[2])
    position = np.hypot(params.way_share * way, least)
    drift = np.radians(params.drift_deg) ** 2 * way
    return np.array([position, position, np.sqrt((params.way_share * turn) ** 2 + drift + MIN_TURN_SIGMA**2)])
