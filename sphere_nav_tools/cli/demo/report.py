"""Errors of a drive against the taught drive, both by the simulator's truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.geometry.trajectory_error import absolute_errors, directions_of_motion
from sphere_nav_tools.cli.constants import MOVING, TRUTH_SPACING
from sphere_nav_tools.offline.pose_bags import read_poses

TRUTH, ESTIMATE = "/ground_truth/odometry", "/pose"


@dataclass(frozen=True, eq=False)
class DriveErrors:
    """lateral (N,) m: true distance from the taught path, left positive, at path lengths `along` (N,) m.

    `longitudinal` (M,) m: estimated minus true place along the direction of motion, for each pose of the localiser.
    """

    taught: Array
    driven: Array
    along: Array
    lateral: Array
    longitudinal: Array
    share_driven: float


def drive_errors(teach: Path, drive: Path, T_world_map: SE3, path: Array | None = None) -> DriveErrors:
    """Compare the drive with the teaching drive; `T_world_map` ties the map to the simulator's world.

    `path` (M, 3) m, rad: poses in the world that were to be driven, where they are not those of the teaching drive.
    """
    truth = read_truth(drive)
    driven = _crop_to_motion(truth)
    xy = _crop_to_motion(read_truth(teach)).positions[:, :2] if path is None else path[:, :2]
    along, lateral = distances_from_path(driven.positions[:, :2], xy, None if path is None else path[:, 2])
    estimate = read_estimate(drive).moved(T_world_map)
    at, known = truth.at(estimate.stamps_ns, max_gap_ns=round(2e8))
    found = absolute_errors(estimate[known], at, directions_of_motion(at))
    length = float(np.hypot(*np.diff(xy, axis=0).T).sum())
    return DriveErrors(
        xy,
        driven.positions[:, :2],
        along,
        lateral,
        found.longitudinal_m,
        float(along.max() / length),
    )


def distances_from_path(points: Array, path: Array, yaw: Array | None = None) -> tuple[Array, Array]:
    """Return where along a path (M, 2) each point (N, 2) is, and how far to the left of it, both in metres.

    The place only moves forward, at most 2 m a point, so that a path may cross itself. `yaw` (M,) rad: headings of the
    vehicle, where the path has cusps, at which its points have no direction.
    """
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    distinct = np.concatenate([[True], np.diff(length) > 0])
    s = np.arange(0.0, length[-1], TRUTH_SPACING)
    dense = np.stack([np.interp(s, length[distinct], path[distinct, axis]) for axis in (0, 1)], axis=-1)
    ahead = np.gradient(dense, axis=0)
    if yaw is not None:
        there = np.interp(s, length[distinct], np.unwrap(yaw)[distinct])
        heading = np.stack([np.cos(there), np.sin(there)], axis=-1)
        ahead = heading * np.where(np.sum(ahead * heading, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    place, places, lateral = 0, [], []
    reach = round(2.0 / TRUTH_SPACING)
    for point in points:
        window = slice(max(0, place - 10), place + reach)
        place = window.start + int(np.argmin(np.sum((dense[window] - point) ** 2, axis=1)))
        off = point - dense[place]
        places.append(s[place])
        lateral.append(ahead[place, 0] * off[1] - ahead[place, 1] * off[0])
    return np.array(places), np.array(lateral)


def read_truth(bag: Path) -> Trajectory:
    """Return the true poses of the vehicle in a bag of the simulator."""
    return read_poses(bag, (TRUTH,))


def read_estimate(bag: Path) -> Trajectory:
    """Return the poses of the vehicle that the localiser published."""
    return read_poses(bag, (ESTIMATE,))


def _crop_to_motion(trajectory: Trajectory) -> Trajectory:
    """Return the part between the first and the last motion."""
    steps = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)
    seconds = np.diff(trajectory.stamps_ns) / 1e9
    moving = np.flatnonzero(steps > MOVING * np.maximum(seconds, 1e-9))
    if not moving.size:
        raise ValueError("drive: expected a car that moves, found one that stands")
    return trajectory[slice(int(moving[0]), int(moving[-1]) + 2)]
