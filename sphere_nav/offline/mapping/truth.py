"""The true poses of a bag that is mapped, and the map moved to them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.offline.evaluation import TRUTH_TOPICS
from sphere_nav.offline.pose_bags import read_poses
from sphere_nav.ros.bags import BagReader
from sphere_nav.spheres.graph import SphereGraph


@dataclass(frozen=True, eq=False)
class Truth:
    """True poses; `is_base` where they are the vehicle's, not the camera's."""

    poses: Trajectory
    is_base: bool


def truth_of(path: Path) -> Truth | None:
    """Return the true poses of a bag, None where it has none."""
    with BagReader(path) as bag:
        topics = [topic for topic in TRUTH_TOPICS if "/" + topic in bag.topics and bag.topics["/" + topic].count]
    return Truth(read_poses(path, (topics[0],)), is_base=topics[0].endswith("odometry")) if topics else None


def fit_poses(theirs: SE3, ours: SE3) -> SE3:
    """Return T_theirs_ours that brings poses (N,) together best: rotations by their mean, then positions."""
    R = so3.nearest_rotations(np.sum(theirs.rotation @ np.swapaxes(ours.rotation, -1, -2), axis=0))
    return SE3.from_parts(R, np.mean(theirs.translation - ours.translation @ R.T, axis=0))


def transform_graph(graph: SphereGraph, T_new_map: SE3) -> SphereGraph:
    """Return the graph in another map frame."""
    return graph.with_poses({node.id: T_new_map @ node.T_map_sphere for node in graph})


def move_to_truth(graph: SphereGraph, truth: Truth, T_base_sphere: SE3) -> SphereGraph:
    """Return the graph with every key sphere at its true pose, where that is known at its stamp."""
    T_body_sphere = T_base_sphere if truth.is_base else SE3.identity()
    poses = {}
    for node in graph:
        at, known = truth.poses.at([node.stamp_ns], max_gap_ns=round(1e9))
        if known.all():
            poses[node.id] = at.T_map_body[0] @ T_body_sphere
    return graph.with_poses(poses)
