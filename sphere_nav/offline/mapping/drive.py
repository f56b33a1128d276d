"""A drive that was mapped: its trajectory, its truth, and what is told of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sphere_mapping.ros.node import SphereMapper
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.offline.evaluation import evaluate_poses
from sphere_nav.offline.mapping.truth import Truth, fit_poses


@dataclass(eq=False)
class MappedDrive:
    """The node after the last message of the bag."""

    node: SphereMapper
    num_lost: int = 0
    refusal: str = ""
    stereo: str = ""  # what was found of the pair
    depth: str = ""  # and of the depth camera, where it sits elsewhere

    def trajectory(self, *, is_base: bool) -> Trajectory:
        """Return the pose of every placed sphere, or that of the vehicle, as the corrected graph has it."""
        T_sphere_body = self.node.T_base_sphere.inverse() if is_base else SE3.identity()
        stamps, poses = zip(*self.node.mapper.trajectory(), strict=True)
        matrices = np.stack([(T_map_sphere @ T_sphere_body).matrix for T_map_sphere in poses])
        return Trajectory(np.array(stamps, dtype=np.int64), SE3(matrices))

    def anchor(self, truth: Truth) -> SE3 | None:
        """Return T_truth_map, so that the first sphere is where the truth has it; None where the truth lacks it."""
        mine = self.trajectory(is_base=truth.is_base)
        at, known = truth.poses.at(mine.stamps_ns[:1], max_gap_ns=round(1e9))
        return at.T_map_body[0] @ mine.T_map_body[0].inverse() if known.any() else None

    def fit(self, truth: Truth) -> SE3 | None:
        """Return T_truth_map that fits all spheres best, so that no single true pose decides; None without truth."""
        mine = self.trajectory(is_base=truth.is_base)
        at, known = truth.poses.at(mine.stamps_ns, max_gap_ns=round(1e9))
        if not known.any():
            return None
        return fit_poses(at.T_map_body, mine.T_map_body[known])

    def summary(self, loops: int, truth: Truth | None, T_truth_map: SE3 | None) -> list[str]:
        """Return what is printed."""
        mapper = self.node.mapper
        placed = self.trajectory(is_base=False)
        lines = [
            f"{len(placed)} spheres placed, {self.num_lost} lost, {len(mapper.graph)} kept, {loops} loops closed, "
            f"{placed.distances[-1]:.2f} m"
        ]
        if self.stereo:
            lines.insert(0, self.stereo)
        if self.depth:
            lines.append(self.depth)
        if self.refusal:
            lines.append(f"refused: {self.refusal}")
        if truth is None or T_truth_map is None:
            return lines
        estimate = self.trajectory(is_base=truth.is_base).moved(T_truth_map)
        judged = evaluate_poses(estimate, truth.poses, is_interpolated=True)
        error, turn = judged.report["translation_m"], judged.report["rotation_deg"]
        end, length = float(judged.errors.translation_m[-1]), judged.report["length_m"]
        lines.append(
            f"against the truth from the first pose on: median {1e3 * error['median']:.1f} mm, "
            f"max {1e3 * error['max']:.1f} mm, median {turn['median']:.2f} deg, max {turn['max']:.2f} deg"
        )
        lines.append(f"drift at the end: {1e3 * end:.1f} mm in {length:.2f} m ({100 * end / max(length, 1e-9):.2f} %)")
        return lines
