"""`homing`: a path driven by the direction to the next waypoint alone, without a pose (N17 section III-D, fig. 8)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from nav_msgs.msg import Path as PathMessage

from benchmarks.papers.drives import PANORAMA, PaperDrive
from benchmarks.papers.plans import planar
from benchmarks.papers.result import JudgedFigure
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import poses_to_path
from sphere_nav_tools.cli.demo.demo import DRIVE_TOPICS
from sphere_nav_tools.cli.demo.plots import save_figure
from sphere_nav_tools.cli.demo.report import distances_from_path, read_truth
from sphere_nav_tools.cli.demo.watch import DriveMonitor
from sphere_nav_tools.offline.pose_bags import read_poses

GOOD_DEG = 45.0  # a direction this close to that of the path ahead brings the car nearer
AHEAD = 4.0  # m along the path: where the true direction points
BEGIN = 2.0  # m along the taught path, of the path that is shown
DIRECTION = "/homing/direction"


class HomingDrive(PaperDrive):
    """100 m by direction."""

    purpose = "100 m by the direction to the next waypoint alone, in bare geometry (N17 fig. 8)"
    simulator: Mapping[str, Any] = PANORAMA | {"camera.period": 0.4}
    follower: Mapping[str, Any] = {
        "source": "homing",
        "safety.max_pose_silence": 3.0,  # some images of a bend are not clear
        "safety.max_blind_time": 3.0,
    }
    recorded = f"{DRIVE_TOPICS} {DIRECTION} /homing/status"
    end_bound, max_bound = 1.0, 1.5  # m

    def localizers(self) -> dict[str, Mapping[str, Any]]:
        """Return `mcl_depth` alone."""
        return {"mcl_depth": self.survey()}

    def depart(self, watch: DriveMonitor) -> None:
        """Show the path before the first image, then start as ever; where the car stands no direction leads to it."""
        taught = read_tum(self.taught / "taught.tum")
        taught = taught[taught.distances >= BEGIN]
        shown = watch.node.create_publisher(PathMessage, "reference_path", qos.LATCHED)
        poses = [(int(stamp), taught.T_map_body[index]) for index, stamp in enumerate(taught.stamps_ns)]
        shown.publish(poses_to_path(poses, 0, "map"))
        super().depart(watch)

    def evaluate(self) -> tuple[list[JudgedFigure], Mapping[str, Any]]:
        """Judge by the truth, draw."""
        with self.stage("judge"):
            taught, truth = planar(read_truth(self.taught / "teach")), read_truth(self.folder / "drive")
            found = read_poses(self.folder / "drive", (DIRECTION,))
            at, known = truth.at(found.stamps_ns)
            poses, directions = planar(at), np.atleast_1d(found[known].T_map_body.yaw)
            self.plot(taught, planar(truth), poses, directions)
        figures = homing_figures(taught, planar(truth), poses, directions, self.end_bound, self.max_bound)
        return [*figures, JudgedFigure("end of the path told", float(self.has_finished), "", 1.0, True)], {}

    def plot(self, taught: Array, driven: Array, poses: Array, directions: Array) -> None:
        """Draw both ways and the directions (N17 fig. 8) from above."""
        figure, axes = plt.subplots(figsize=(8, 8))
        axes.plot(*taught[:, :2].T, "-", color="0.6", linewidth=3, label="taught (truth)")
        axes.plot(*driven[:, :2].T, "-", color="tab:red", label="driven by direction (truth)")
        angles = poses[:, 2] + directions
        arrows = 3.0 * np.cos(angles), 3.0 * np.sin(angles)  # m
        axes.quiver(
            *poses[:, :2].T, *arrows, angles="xy", scale_units="xy", scale=1, width=0.002, color="tab:blue",
            label="direction of an image",
        )  # fmt: skip
        axes.set(aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="y [m]", title="Motion directions")
        axes.grid(alpha=0.3)
        axes.legend()
        save_figure(figure, self.folder / "top_view.png")


def homing_figures(
    taught: Array, driven: Array, poses: Array, directions: Array, end_bound: float, max_bound: float
) -> list[JudgedFigure]:
    """Judge a drive (N, 3) by a taught one (M, 3); `directions` (K,) rad, from the heading, were told at `poses`."""
    along, lateral = distances_from_path(driven[:, :2], taught[:, :2])
    steps = np.hypot(*np.diff(taught[:, :2], axis=0).T)
    length, distinct = np.concatenate([[0.0], np.cumsum(steps)]), np.concatenate([[True], steps > 0.0])
    at = along[np.argmin(np.hypot(*(poses[:, None, :2] - driven[None, :, :2]).transpose(2, 0, 1)), axis=1)]
    goals = [np.interp(at + AHEAD, length[distinct], taught[distinct, axis]) for axis in (0, 1)]
    true = np.arctan2(goals[1] - poses[:, 1], goals[0] - poses[:, 0])
    off = np.degrees(np.abs(np.angle(np.exp(1j * (poses[:, 2] + directions - true)))))
    from_end = float(np.hypot(*(driven[-1] - taught[-1])[:2]))
    is_good = f"directions within {GOOD_DEG:g} deg of the path {AHEAD:g} m ahead"
    return [
        JudgedFigure("end of the drive from the end of the path", from_end, "m", end_bound),
        JudgedFigure("distance from the path, largest", float(np.abs(lateral).max()), "m", max_bound),
        JudgedFigure("distance from the path, median", float(np.median(np.abs(lateral))), "m"),
        JudgedFigure("share of the path that was driven", float(along.max() / length[-1]), "", 0.95, is_minimum=True),
        JudgedFigure(is_good, 100.0 * float(np.mean(off <= GOOD_DEG)), "%"),
        JudgedFigure("directions off, median", float(np.median(off)), "deg"),
    ]
