"""Errors of a drive against the taught drive, both by the simulator's truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from path_follower.path import Pose2, ReferencePath, Segment
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, arc_lengths
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav_tools.cli.constants import MOVING
from sphere_nav_tools.offline.evaluation import Judged, evaluate_poses
from sphere_nav_tools.offline.pose_bags import read_poses

TAUGHT = "taught.tum"
TRUTH, ESTIMATE = "/ground_truth/odometry", "/pose"


@dataclass(frozen=True, eq=False)
class DriveErrors:
    """lateral (N,) m: true distance from the taught path, left positive, at path lengths `along` (N,) m.

    `estimate`: the poses of the localiser in the world; `judged`: these against the truth.
    """

    taught: ReferencePath
    along: Array
    lateral: Array
    estimate: Trajectory
    judged: Judged

    @property
    def share_driven(self) -> float:
        """Share of the taught path."""
        return float(self.along.max() / self.taught.length)


def find_map(folder: Path) -> SE3:
    """Return T_world_map: the map begins where the teaching drive truly began."""
    truth, taught = read_truth(folder / "teach"), read_tum(folder / TAUGHT)
    first = np.maximum(taught.stamps_ns[:1], truth.stamps_ns[0])  # the car still stands when recording begins
    at, known = truth.at(first)
    if not known.all():
        raise ValueError("teaching drive: expected a true pose of the first sphere, found none")
    return at.T_map_body[0] @ taught.T_map_body[0].inverse()


def drive_errors(teach: Path, drive: Path, T_world_map: SE3) -> DriveErrors:
    """Compare the drive with the teaching drive; `T_world_map` ties the map to the simulator's world."""
    truth, taught = read_truth(drive), path_of(_crop_to_motion(read_truth(teach)))
    along, lateral = distances_from_path(_crop_to_motion(truth).positions[:, :2], taught)
    estimate = read_poses(drive, (ESTIMATE,)).moved(T_world_map)
    return DriveErrors(taught, along, lateral, estimate, evaluate_poses(estimate, truth, is_interpolated=True))


def path_of(driven: Trajectory) -> ReferencePath:
    """Return the path of a drive as it was, without smoothing."""
    xy, yaw = driven.positions[:, :2], np.unwrap(driven.T_map_body.yaw)
    nothing = np.zeros(len(xy))
    return ReferencePath(xy[:, 0], xy[:, 1], yaw, nothing, arc_lengths(xy), nothing, (Segment(0, len(xy) - 1, 1),))


def distances_from_path(points: Array, path: ReferencePath) -> tuple[Array, Array]:
    """Return where along a path each point (N, 2) is, and how far to the left of it, both in metres.

    The place only moves forward, at most 2 m a point, so that a path may cross itself.
    """
    places = [path.begin_of(0)]
    for x, y in points:
        places.append(path.advance(Pose2(x, y, 0.0), places[-1], 2.0))
    along, lateral = np.array([(place.arc_length, place.cross_track) for place in places[1:]]).T
    return along, lateral


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
