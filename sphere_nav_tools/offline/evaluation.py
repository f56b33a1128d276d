"""Trajectories of files and bags; estimated poses against true ones: paired by stamps, aligned, measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.geometry.trajectory import Trajectory, associate, read_tum
from sphere_nav.geometry.trajectory_error import (
    AbsoluteErrors,
    RelativeErrors,
    Statistics,
    absolute_errors,
    align_trajectories,
    directions_of_motion,
    nees,
    relative_errors,
)
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.camera.odometry_input import is_truth
from sphere_nav.ros.conversions import pose_to_se3, pose_with_covariance_to_se3, stamp_ns
from sphere_nav.ros.interfaces import type_name
from sphere_nav_tools.offline.tables import facts_as_lines

TRUTH_TOPICS = ("ground_truth/pose", "ground_truth/odometry")
ESTIMATE_TOPICS = ("pose", "odometry")
MAX_TRUTH_GAP_NS = 1_000_000_000  # between two true poses that tell one between them
AUTO = "auto"  # alignment: by poses where map and truth have frames of their own
OWN_FRAME = (0.5, np.radians(5.0))  # m, rad that medians are off at least where frames differ, and this many times what
OWN_FRAME_RATIO = 5.0  # is left once the poses are aligned; test_evaluation
BAG_SUFFIXES = (".mcap", ".db3", ".bag")
PoseReading = tuple[SE3, Array | None]  # a pose with its covariance (6, 6), where one is told
READINGS: dict[str, Callable[[Any], PoseReading]] = {
    type_name(PoseStamped): lambda message: (pose_to_se3(message.pose), None),
    type_name(PoseWithCovarianceStamped): pose_with_covariance_to_se3,
    type_name(Odometry): pose_with_covariance_to_se3,
}


@dataclass(frozen=True, eq=False)
class Judged:
    """The paired truth, the errors of each pair, how the estimate was moved before, and the numbers of the report."""

    truth: Trajectory
    errors: AbsoluteErrors
    T_truth_estimate: SE3
    scale: float
    report: dict[str, Any]


def evaluate_poses(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    alignment: str = "none",
    tolerance_s: float = 0.01,
    is_interpolated: bool = False,
    rpe_length_m: float = 1.0,
    aligned_by: tuple[Trajectory, Trajectory] | None = None,
) -> Judged:
    """Measure an estimate; also for benchmarks and the demo. ValueError if no stamps are in common.

    `aligned_by`: another estimate in the same frame and its truth, such as those of the drive that made the map. The
    alignment is found on these alone; else on the estimate itself.
    """
    tolerance_ns = round(tolerance_s * 1e9)
    covered, _ = associate(truth.stamps_ns, estimate.stamps_ns, tolerance_ns)
    paired, paired_truth, directions = _pair(estimate, truth, tolerance_ns, is_interpolated=is_interpolated)
    if not len(paired):
        raise ValueError(f"stamps: expected some in common within {tolerance_s:g} s, found {_spans(estimate, truth)}")
    is_chosen = alignment == AUTO
    if is_chosen:
        alignment = "poses" if aligned_by is not None or have_own_frames(paired, paired_truth) else "none"
    T_truth_estimate, scale = find_alignment((paired, paired_truth), alignment, aligned_by)
    paired = paired.moved(T_truth_estimate, scale)
    errors = absolute_errors(paired, paired_truth, directions)
    report = {
        "n": len(paired),
        "coverage": len(covered) / len(truth),
        **_statistics(errors, lateral_m=errors.lateral_m, longitudinal_m=errors.longitudinal_m),
        "rpe": _relative(relative_errors(paired, paired_truth, rpe_length_m), rpe_length_m),
        "nees": _consistency(paired, paired_truth),
        "alignment": {
            "kind": alignment,
            "is_chosen": is_chosen,
            "scale": scale,
            "T_truth_estimate": T_truth_estimate.matrix.tolist(),
        },
        "num_estimates": len(estimate),
        "num_truth": len(truth),
        "length_m": float(paired_truth.distances[-1]),
    }
    return Judged(paired_truth, errors, T_truth_estimate, scale, report)


def _pair(
    estimate: Trajectory, truth: Trajectory, tolerance_ns: int, *, is_interpolated: bool
) -> tuple[Trajectory, Trajectory, Array]:
    """Return the poses that both have, and the directions (N, 2) in which the truth moves there."""
    directions = directions_of_motion(truth)
    if not is_interpolated:
        first, second = associate(estimate.stamps_ns, truth.stamps_ns, tolerance_ns)
        return estimate[first], truth[second], directions[second]
    paired_truth, known = truth.at(estimate.stamps_ns, MAX_TRUTH_GAP_NS)
    return estimate[known], paired_truth, directions_of_motion(paired_truth) if known.any() else directions[:0]


def have_own_frames(estimate: Trajectory, truth: Trajectory) -> bool:
    """Whether paired poses differ by where their frames are, far more than by anything that is left then."""
    if len(estimate) == 1:
        return False  # it fits whatever it is
    moved = estimate.moved(*align_trajectories(estimate, truth, "poses"))
    raw, left = (np.median(one.T_map_body.distance(truth.T_map_body), axis=1) for one in (estimate, moved))
    return bool(np.any(raw > np.maximum(OWN_FRAME, OWN_FRAME_RATIO * left)))


def describe_alignment(judged: Judged) -> str:
    """Return in one line what was done to compare frames, nothing where they were taken as they are."""
    found = judged.report["alignment"]
    if found["kind"] == "none":
        return ""
    meters, radians = judged.T_truth_estimate.distance(SE3.identity())
    size = f", scale {judged.scale:.5f}" if judged.scale != 1.0 else ""
    line = f"aligned by {found['kind']}: {meters:.4f} m, {np.degrees(radians):.3f} deg{size}"
    why = ": map and truth have frames of their own (--align none compares them as they are)"
    return line + why * found["is_chosen"]


def find_alignment(
    paired: tuple[Trajectory, Trajectory], kind: str, aligned_by: tuple[Trajectory, Trajectory] | None
) -> tuple[SE3, float]:
    """Return T_truth_estimate and scale by an estimate and its truth: the paired one, or another one that is given."""
    if aligned_by is not None:
        return align_at(*aligned_by, kind)
    if kind != "none" and len(paired[0]) == 1:
        raise ValueError(f"--align {kind}: expected several poses to align by, found one, which fits in any case")
    return align_trajectories(*paired, kind)


def align_at(estimate: Trajectory, truth: Trajectory, kind: str) -> tuple[SE3, float]:
    """Return T_truth_estimate and scale by the truth at the stamps of an estimate; ValueError where there is none."""
    at, known = truth.at(estimate.stamps_ns, MAX_TRUTH_GAP_NS)
    if not known.any():
        raise ValueError(f"stamps: expected some in common to align by, found {_spans(estimate, truth)}")
    return align_trajectories(estimate[known], at, kind)


def report_lines(judged: Judged) -> list[str]:
    """Return the report as text: a line for each quantity, and how the frames were compared."""
    told = {name: value for name, value in judged.report.items() if name != "alignment"}
    return [*facts_as_lines(told), *filter(None, [describe_alignment(judged)])]


def _relative(errors: RelativeErrors, length_m: float) -> dict[str, Any]:
    percent = 100 * errors.translation_m / errors.length_m
    return {"n": len(errors.length_m), "length_m": length_m, **_statistics(errors, translation_percent=percent)}


def _consistency(estimate: Trajectory, truth: Trajectory) -> dict[str, Any] | None:
    squared = nees(estimate, truth)
    squared = squared[np.isfinite(squared)]
    if not squared.size:
        return None
    return {"n": len(squared), "mean": float(squared.mean()), "median": float(np.median(squared))}


def _statistics(errors: AbsoluteErrors | RelativeErrors, **others: Array) -> dict[str, Any]:
    """Return median, rmse, p95 and max of errors by name; None where there are none."""
    values = {"translation_m": errors.translation_m, "rotation_deg": np.degrees(errors.rotation_rad)} | others
    found = {name: Statistics.of(one) for name, one in values.items()}
    return {name: dataclasses.asdict(one) if one is not None else None for name, one in found.items()}


def _spans(*trajectories: Trajectory) -> str:
    ends = (t.stamps_ns[[0, -1]] / 1e9 if len(t) else None for t in trajectories)
    return " against ".join("no poses" if span is None else f"{span[0]:.3f} ... {span[1]:.3f} s" for span in ends)


# --- of files and bags
def read_trajectory(path: Path, topic: str | None, usual: tuple[str, ...]) -> Trajectory:
    """Return poses of a TUM file or of the first usual topic of a bag; ValueError where there are none."""
    if is_bag(path):
        return read_poses(path, (topic,) if topic else usual)
    if not path.exists():
        raise ValueError(f"{path}: expected a TUM file or a bag, found none")
    if topic:
        raise ValueError(f"{path}: expected a bag, as a topic ({topic}) is named, found a file of another kind")
    return read_tum(path)


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
