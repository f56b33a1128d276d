"""A drive that was mapped: its trajectory, where the true poses of its bag lay it, and what is told of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from sphere_mapping.acquisition.stereo.stereo_pair import StereoPair
from sphere_mapping.mapper import Mapper
from sphere_mapping.ros.mount import CameraMount
from sphere_nav.estimation.least_squares import gate, squared_distance
from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav_tools.offline.constants import EDGE_FACTOR, MOST, SURVEY_SIGMA
from sphere_nav_tools.offline.evaluation import (
    MAX_TRUTH_GAP_NS,
    TRUTH_TOPICS,
    align_at,
    find_topic,
    read_poses,
    trajectory_of,
)
from sphere_nav_tools.offline.mapping.stitcher_ahead import Node
from sphere_nav_tools.offline.tables import REMEDY


@dataclass(frozen=True, eq=False)
class Recipe:
    """By what a drive is mapped: the bag, parameters and topics, and what is known of the cameras."""

    bag: Path
    values: Mapping[str, Any]
    remap: dict[str, str]
    details: MapDetails
    kind: str  # cameras, sphere, rgbd, stereo
    stitcher: Node | None = None
    pair: StereoPair | None = None
    stereo: str = ""  # what was found of the pair


@dataclass(eq=False)
class MappedDrive:
    """What was mapped, by what camera, and what was not.

    refusal: of what, and why, in one line.
    """

    recipe: Recipe
    mapper: Mapper
    mount: CameraMount
    num_lost: int = 0
    refusal: str = ""

    def trajectory(self, *, is_base: bool) -> Trajectory:
        """Return the pose of the camera (body axes) of every placed sphere, or the vehicle's, as the graph has it."""
        mount = self.mount
        T_sphere_pose = mount.T_base_sphere.inverse() if is_base else mount.T_sphere_body
        stamps, poses = zip(*self.mapper.trajectory(), strict=True)
        return trajectory_of(stamps, [T_map_sphere @ T_sphere_pose for T_map_sphere in poses])

    def anchor_graph(self, anchor: str, source: Path) -> tuple[SE3, SphereGraph, list[str]]:
        """Return T_new_map as the anchor asks for, the graph there, and what is to be warned of.

        anchor: first, truth or survey, as of `sphere_nav map`; source: the bag. BagError where the truth is asked for
        and not known.
        """
        graph = self.mapper.graph
        if anchor == "first":
            return SE3.identity(), graph, []
        truth = read_truth(source, self.mount)
        with told_at(source, BagError):
            T_fitted_map, _ = align_at(trajectory_of(*zip(*self.mapper.trajectory(), strict=True)), truth, "poses")
        graph = graph.with_poses({node.id: T_fitted_map @ node.T_map_sphere for node in graph})
        if anchor == "truth":
            return T_fitted_map, graph, []
        surveyed = move_to_truth(graph, truth)
        return T_fitted_map, surveyed, check_survey(graph, surveyed, source)

    @property
    def loss(self) -> str:
        """One line where most spheres were lost and what would help, else nothing."""
        total = self.num_lost + len(self.mapper.tracks)
        if self.num_lost <= MOST * total:
            return ""
        return (
            f"expected most of {total} spheres placed, found {self.num_lost} lost ({self.num_lost / total:.0%}): "
            f"{REMEDY}, or recorded odometry, would help"
        )

    def summary(self) -> list[str]:
        """Return what is printed."""
        mapper, placed = self.mapper, self.trajectory(is_base=False)
        lines = [self.recipe.stereo] if self.recipe.stereo else []
        lines.append(
            f"{len(placed)} spheres placed, {self.num_lost} lost, {len(mapper.graph)} kept, {mapper.num_loops} loops "
            f"closed, {placed.distances[-1]:.2f} m"
        )
        return lines + [f"refused: {self.refusal}"] * bool(self.refusal)


def read_truth(path: Path, mount: CameraMount) -> Trajectory:
    """Return the true poses of the spheres of a camera, by those of the vehicle or of the camera; BagError: none."""
    with BagReader(path) as bag:
        topic = find_topic(bag, TRUTH_TOPICS) or TRUTH_TOPICS[0]
    told = read_poses(path, (topic,))
    T_pose_sphere = mount.T_base_sphere if topic.endswith("odometry") else mount.T_sphere_body.inverse()
    return Trajectory(told.stamps_ns, told.T_map_body @ T_pose_sphere)


def move_to_truth(graph: SphereGraph, truth: Trajectory) -> SphereGraph:
    """Return the graph with every key sphere at its true pose, where that is known at its stamp."""
    at, known = truth.at([node.stamp_ns for node in graph], MAX_TRUTH_GAP_NS)
    ids = compress((node.id for node in graph), known)
    return graph.with_poses({node_id: at.T_map_body[index] for index, node_id in enumerate(ids)})


def check_survey(aligned: SphereGraph, surveyed: SphereGraph, source: Path) -> list[str]:
    """Compare the aligned edges with the surveyed poses of the same key spheres; return warnings, the worst by name.

    BagError where most edges contradict the survey: the poses are wrong, of another frame or of other stamps.
    """
    wrong = list(_contradictions(aligned, surveyed))
    if not wrong:
        return []
    worst = max(wrong)[1]
    what = f"{len(wrong)} of {len(aligned.edges)} motions between key spheres contradict the survey, {worst} at worst"
    if len(wrong) > MOST * len(aligned.edges):
        raise BagError(f"{source}: expected surveyed poses that agree with the images, found {what}")
    return [f"warning: {what}"]


def _contradictions(aligned: SphereGraph, surveyed: SphereGraph) -> Iterator[tuple[float, str]]:
    """Yield how far the survey is from each edge that it contradicts, in standard deviations of both, and in words."""
    for edge in aligned.edges:
        T_a_b = surveyed[edge.a].T_map_sphere.inverse() @ surveyed[edge.b].T_map_sphere
        covariance = EDGE_FACTOR**2 * np.linalg.pinv(edge.information) + np.diag(SURVEY_SIGMA**2)
        sigmas = float(np.sqrt(squared_distance(edge.T_a_b, T_a_b, covariance)))
        if sigmas**2 > gate(6, 1e-4):
            meters, radians = edge.T_a_b.distance(T_a_b)
            off = f"{1e3 * meters:.0f} mm, {np.degrees(radians):.2f} deg ({sigmas:.1f} sigma)"
            yield sigmas, f"{edge.a} to {edge.b} by {off}"
