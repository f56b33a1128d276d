"""Trajectories out of bags."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.camera.odometry_input import is_truth
from sphere_nav.ros.conversions import pose_to_se3, pose_with_covariance_to_se3, stamp_ns
from sphere_nav.ros.interfaces import type_name

BAG_SUFFIXES = (".mcap", ".db3", ".bag")
PoseReading = tuple[SE3, Array | None]  # a pose with its covariance (6, 6), where one is told
READINGS: dict[str, Callable[[Any], PoseReading]] = {
    type_name(PoseStamped): lambda message: (pose_to_se3(message.pose), None),
    type_name(PoseWithCovarianceStamped): pose_with_covariance_to_se3,
    type_name(Odometry): pose_with_covariance_to_se3,
}


def trajectory_of(stamps: Sequence[int], poses: Sequence[SE3]) -> Trajectory:
    """Return poses by their stamps in ns."""
    matrices = np.array([pose.matrix for pose in poses]).reshape(-1, 4, 4)
    return Trajectory(np.array(stamps, dtype=np.int64), SE3(matrices))


def sort_poses(poses: Mapping[int, PoseReading]) -> Trajectory:
    """Return poses by their stamps, in the order of time; with covariances where all have one."""
    chosen = [poses[stamp] for stamp in sorted(poses)]
    found = trajectory_of(sorted(poses), [pose for pose, _ in chosen])
    if not all(covariance is not None and np.any(covariance) for _, covariance in chosen):
        return found
    return replace(found, covariances=np.reshape([covariance for _, covariance in chosen], (-1, 6, 6)))


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a folder, or a file of one."""
    return path.is_dir() or path.suffix in BAG_SUFFIXES


def read_poses(path: Path, topics: Sequence[str]) -> Trajectory:
    """Read what `find_topic` finds by `topics`, by the stamps of its headers; a repeated stamp counts once."""
    with BagReader(path) as bag:
        info = bag.require(find_topic(bag, topics) or topics[0])
        if info.type not in READINGS:
            raise BagError(f"{path}: {info.name}: expected one of {', '.join(READINGS)}, found {info.type}")
        poses = {}
        for _, _, message in bag.messages([info.name]):
            stamp = stamp_ns(message)
            with told_at(f"{path}: {info.name}: stamp {stamp / 1e9:.9f}", BagError):
                poses[stamp] = READINGS[info.type](message)
    return sort_poses(poses)


def find_topic(bag: BagReader, names: Sequence[str]) -> str:
    """Return the topic of poses that is, or ends as, the first name does, the shortest; no truth for an estimate.

    Empty where there is none.
    """
    topics = [info.name for info in bag.topics.values() if info.count and info.type in READINGS]
    for name in names:
        for topic in sorted(topics, key=len):
            if (topic == name or topic.endswith(f"/{name}")) and is_truth(topic) == is_truth(name):
                return topic
    return ""
