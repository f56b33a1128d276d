"""Errors of a drive against the taught drive, both by the simulator's truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, arc_lengths
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.geometry.trajectory_error import absolute_errors, directions_of_motion
from sphere_nav_tools.cli.constants import MOVING, TRUTH_SPACING
from sphere_nav_tools.offline.pose_bags import read_poses

TAUGHT = "taught.tum"
TRUTH, ESTIMATE = "/ground_truth/odometry", "/pose"


@dataclass(frozen=True, eq=False)
class DriveErrors:
    """lateral (N,) m: true distance from the taught path, left positive, at path lengths `along` (N,) m.

    `longitudinal` (M,) m: estimated minus true place along the direction of motion, for each pose of the localiser, at
    `seconds` (M,). `drift` (M,) m: what of it the map was off itself there, when it was taught.
    """

    taught: Array
    driven: Array
    along: Array
    lateral: Array
    seconds: Array
    longitudinal: Array
    drift: Array
    share_driven: float


def find_map(folder: Path) -> SE3:
    """Return T_world_map: the map begins where the teaching drive truly began."""
    truth, taught = read_truth(folder / "teach"), read_tum(folder / TAUGHT)
    first = np.maximum(taught.stamps_ns[:1], truth.stamps_ns[0])  # the car still stands when recording begins
    at, known = truth.at(first)
    if not known.all():
        raise ValueError("teaching drive: expected a true pose of the first sphere, found none")
    return at.T_map_body[0] @ taught.T_map_body[0].inverse()


def drive_errors(teach: Path, drive: Path, T_world_map: SE3) -> DriveErrors:
    """Compare the drive with the teaching drive; `T_world_map` ties the map to the simulator's world.

    The poses of the map (taught.tum) lie beside the bag of the teaching drive.
    """
    truth = read_truth(drive)
    driven, taught = (_crop_to_motion(one).positions[:, :2] for one in (truth, read_truth(teach)))
    along, lateral = distances_from_path(driven, taught)
    estimate = read_poses(drive, (ESTIMATE,)).moved(T_world_map)
    at, known = truth.at(estimate.stamps_ns, max_gap_ns=round(2e8))
    found = absolute_errors(estimate[known], at, directions_of_motion(at)).longitudinal_m
    seconds = (estimate.stamps_ns[known] - estimate.stamps_ns[0]) / 1e9
    drift = map_drift(at.positions[:, :2], teach.with_name(TAUGHT), read_truth(teach), T_world_map)
    return DriveErrors(
        taught, driven, along, lateral, seconds, found, drift, float(along.max() / arc_lengths(taught)[-1])
    )


def map_drift(places: Array, taught: Path, truth: Trajectory, T_world_map: SE3) -> Array:
    """Return how far ahead of the truth the map is at places (M, 2) m of the world: at its next taught pose."""
    poses = read_tum(taught).moved(T_world_map)
    at, known = truth.at(poses.stamps_ns, max_gap_ns=round(2e8))
    ahead = absolute_errors(poses[known], at, directions_of_motion(at)).longitudinal_m
    nearest = [int(np.argmin(np.sum((at.positions[:, :2] - place) ** 2, axis=1))) for place in places]
    return np.asarray(ahead)[nearest]


def distances_from_path(points: Array, path: Array) -> tuple[Array, Array]:
    """Return where along a path (M, 2) each point (N, 2) is, and how far to the left of it, both in metres.

    The place only moves forward, at most 2 m a point, so that a path may cross itself.
    """
    length = arc_lengths(path)
    distinct = np.concatenate([[True], np.diff(length) > 0])
    s = np.arange(0.0, length[-1], TRUTH_SPACING)
    dense = np.stack([np.interp(s, length[distinct], path[distinct, axis]) for axis in (0, 1)], axis=-1)
    ahead = np.gradient(dense, axis=0)
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


def _crop_to_motion(trajectory: Trajectory) -> Trajectory:
    """Return the part between the first and the last motion."""
    steps = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)
    seconds = np.diff(trajectory.stamps_ns) / 1e9
    moving = np.flatnonzero(steps > MOVING * np.maximum(seconds, 1e-9))
    if not moving.size:
        raise ValueError("drive: expected a car that moves, found one that stands")
    return trajectory[slice(int(moving[0]), int(moving[-1]) + 2)]
