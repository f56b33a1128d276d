"""Errors of a drive against the taught drive, both by the simulator's truth, and a picture of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav_tools.offline.evaluation import Judged, evaluate_poses, read_poses

EXAGGERATION = 50  # of the distance between two paths that no eye could tell apart
WAY = 0.1  # m that a metre on the way counts beside one on the ground, so that a path may cross itself


@dataclass(frozen=True, eq=False)
class DriveErrors:
    """The true poses in motion, and how far to the left of the taught path they are: lateral (N,) m; yaw (N,) there.

    `judged`: the poses of the localiser against the truth, the map put where the taught drive was.
    """

    taught: Trajectory
    driven: Trajectory
    yaw: Array
    lateral: Array
    share_driven: float
    judged: Judged


def drive_errors(folder: Path) -> DriveErrors:
    """Compare the drive with the teaching drive in the folder of a demo."""
    teach, truth = read_truth(folder / "teach"), read_truth(folder / "drive")
    estimate, by = read_poses(folder / "drive", ("/pose",)), (read_tum(folder / "taught.tum"), teach)
    judged = evaluate_poses(estimate, truth, alignment="poses", is_interpolated=True, aligned_by=by)
    taught, driven = _in_motion(teach), _in_motion(truth)
    feet, lateral = distances_from(taught, driven)
    share = float(taught.distances[feet.max()] / taught.distances[-1])
    return DriveErrors(taught, driven, taught.T_map_body.yaw[feet], lateral, share, judged)


def distances_from(taught: Trajectory, driven: Trajectory) -> tuple[NDArray[np.intp], Array]:
    """Return which taught pose is closest to each driven one, and how far that is to the left of it (N,), m."""
    places, wanted = (np.column_stack([one.positions[:, :2], WAY * one.distances]) for one in (taught, driven))
    _, feet = KDTree(places).query(wanted)
    yaw, off = taught.T_map_body.yaw[feet], driven.positions - taught.positions[feet]
    return feet, np.cos(yaw) * off[:, 1] - np.sin(yaw) * off[:, 0]


def read_truth(bag: Path) -> Trajectory:
    """Return the true poses of the vehicle in a bag of the simulator."""
    return read_poses(bag, ("/ground_truth/odometry",))


def _in_motion(trajectory: Trajectory) -> Trajectory:
    """Return the first pose, and every one that is elsewhere than the one before."""
    return trajectory[np.diff(trajectory.distances, prepend=-1.0) > 0.0]


def plot_top_view(path: Path, errors: DriveErrors, key_spheres: Array) -> None:
    """Draw the taught path, the driven one beside it and the key spheres (K, 2) from above, metres.

    The driven path is `EXAGGERATION` times as far from the taught one as the car truly was.
    """
    from sphere_nav_tools.offline.plot_figure import drawn, top_view  # matplotlib takes half a second to import

    label = f"driven by the camera (truth), its distance from the taught path × {EXAGGERATION}"
    with drawn(path, (8, 8)) as figure:
        axes = figure.add_subplot()
        lines = {"taught (truth)": errors.taught.positions[:, :2], label: exaggerate(errors)}
        top_view(axes, lines, {f"{len(key_spheres)} key spheres": key_spheres})
        axes.set_title(f"Taught and driven path, at most {100 * np.abs(errors.lateral).max():.1f} cm apart", loc="left")


def exaggerate(errors: DriveErrors) -> Array:
    """Return the driven positions (N, 2), `EXAGGERATION` times as far from the taught path."""
    left = np.stack([-np.sin(errors.yaw), np.cos(errors.yaw)], axis=1)
    exaggerated: Array = errors.driven.positions[:, :2] + (EXAGGERATION - 1) * errors.lateral[:, None] * left
    return exaggerated
