"""Recordings from end to end through the commands: import, map, localise, against their truth.

Redkitchen is judged by COLMAP's poses, straightened: COLMAP takes a rolling shutter for a global one. The frames that
are mapped, and those of the same kitchen that are localised by colour alone, follow from the seed.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.commands import TRUTH, call, drift, errors, num_false, read_states
from benchmarks.real.straight_truth import straighten
from benchmarks.report import Bound, Headline, Report
from benchmarks.rgbd_data import Recording
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.offline.evaluation import align_at, evaluate_poses, read_poses

HELD_OUT, INTERLEAVED = (8.0, 0.4), (2.5, 0.1)  # mm, deg: medians
NEES = 0.5, 2.0  # least and largest mean, over 6 degrees of freedom
FALSE_FIX_M = 0.15
FALSE_LOOP = 0.1, 2.0  # m, deg off the truth
READOUT_S = 0.0227  # 0.68 of a frame, measured beside COLMAP's poses
KITCHEN_READOUT = f"camera.readout={READOUT_S}"
STEADY = 12  # frames of kitti_06 after which its truth turns as its left image says
POSE, MAP = "pose by image", "map"  # groups of the page


@dataclass(frozen=True)
class Split:
    """Frames that are mapped and frames that are localised, as `sphere_nav import --frames` has them; mm and deg."""

    what: str
    mapped: str
    localised: str
    bound: tuple[float, float]
    anchor: str = "truth"


def splits(seed: int, *, is_quick: bool) -> list[Split]:
    """Return what is mapped and what is localised: frames held out, from a drawn one on, and every second frame."""
    mapped, localised = (80, 40) if is_quick else (120, 120)
    first = seed % (360 - mapped - localised)
    middle, last = first + mapped, first + mapped + localised
    held_out = Split("next frames", f"{first}:{middle}", f"{middle}:{last}", HELD_OUT)
    if is_quick:
        return [held_out]
    odd = Split("odd in even frames", f"{first}:{last}:2", f"{first + 1}:{last}:2", INTERLEAVED)
    survey = Split("next frames, survey", held_out.mapped, held_out.localised, HELD_OUT, "survey")
    return [held_out, survey, odd]


def run(options: argparse.Namespace) -> Report:
    """Measure what is there."""
    report, is_quick = Report("end_to_end", notes=[__doc__ or ""]), options.size == "quick"
    if (recording := Recording.open(options.data)) is not None:
        for split in splits(options.seed, is_quick=is_quick):
            kitchen(recording, split, options.folder / split.what.replace(" ", "_"), report)
    if (options.data / "driving" / "kitti_06").is_dir():
        stereo(options.data / "driving" / "kitti_06", options.folder / "kitti_06", report)
    report.skipped = "" if report.bounds else f"no recordings in {options.data}"
    return report


def kitchen(recording: Recording, split: Split, folder: Path, report: Report) -> None:
    """Map RGB-D frames, localise others by colour alone."""
    truth_of = ("--poses", recording.poses, "--truth-camera", "colour")
    for bag, frames in (("taught", split.mapped), ("driven", split.localised)):
        call("import", "seven_scenes", recording.folder, "-o", folder / bag, "--frames", frames, *truth_of)
    taught, driven, made, way = (folder / name for name in ("taught", "driven", "map", "way.tum"))
    readout = ("--set", KITCHEN_READOUT)
    call("map", taught, "-o", made, "--anchor", split.anchor, *readout, "--trajectory", way)
    call("localize", made, driven, "-o", folder / "poses.tum", "--bag", folder / "said", *readout)
    estimate, truth = read_tum(folder / "poses.tum"), read_poses(driven, TRUTH)
    tracked = [stamp for stamp, (state, _) in read_states(folder / "said").items() if state == "TRACKING"]
    false_fixes = np.sum(errors(estimate[np.isin(estimate.stamps_ns, tracked)], truth) > FALSE_FIX_M)
    straight, T_truth_map = straight_truth(taught, driven, way)
    judged = evaluate_poses(estimate.moved(T_truth_map), straight).report
    told = evaluate_poses(read_poses(folder / "said", ("pose",)).moved(T_truth_map), straight).report["nees"]
    nees = told["mean"] / 6 if told else np.nan
    what, data = f"redkitchen, {split.what}", f"redkitchen {split.localised} in a map of {split.mapped}"
    of = Headline(POSE, data, "COLMAP, right to 5 mm") if split.anchor == "truth" else None
    millimeters, degrees = 1e3 * judged["translation_m"]["median"], judged["rotation_deg"]["median"]
    report.bounds += [
        Bound(f"{what}: median error by colour", split.bound[0], millimeters, "mm", headline=of),
        Bound(f"{what}: median turn", split.bound[1], degrees, "deg"),
        Bound(f"{what}: mean NEES over 6, not less than", NEES[0], nees, "", is_minimum=True),
        Bound(f"{what}: mean NEES over 6, not more than", NEES[1], nees, ""),
        Bound(f"{what}: TRACKING more than {FALSE_FIX_M} m off", 0, int(false_fixes), "images"),
        Bound(f"{what}: images with a pose", 0.5, len(estimate) / len(truth), "", is_minimum=True),
    ]
    if split.anchor == "truth":
        judge_map(what, data, folder, report)


def straight_truth(taught: Path, driven: Path, way: Path) -> tuple[Trajectory, SE3]:
    """Return the driven truth less what a rolling shutter does to poses by a global one, and the map fitted to it."""
    straight = [straighten(bag, read_poses(bag, TRUTH), READOUT_S) for bag in (taught, driven)]
    return straight[1], align_at(read_tum(way), straight[0], "poses")[0]


def judge_map(what: str, data: str, folder: Path, report: Report) -> None:
    """Add how right the poses of all mapped frames are, and which of its loops join what is not together."""
    truth = read_poses(folder / "taught", TRUTH)
    with open_map(folder / "map") as reader:
        graph = reader.graph
    at, known = truth.at([node.stamp_ns for node in graph], max_gap_ns=10**9)
    ids = np.array(list(graph.nodes))[known].tolist()
    true = {node_id: at.T_map_body[index] for index, node_id in enumerate(ids)}
    loops = [edge for edge in graph.edges if edge.is_loop and edge.a in true and edge.b in true]
    false = num_false(loops, true, FALSE_LOOP)
    error = evaluate_poses(read_tum(folder / "way.tum"), truth).report["translation_m"]
    report.notes.append(f"{what}: {len(graph)} key spheres, {len(loops)} loops")
    report.bounds += [
        Bound(f"{what}: mapped frames, median error", 10.0, 1e3 * error["median"], "mm", headline=Headline(MAP, data)),
        Bound(f"{what}: mapped frames, largest", 50.0, 1e3 * error["max"], "mm"),
        Bound(f"{what}: false loops", 0, false, f"of {len(loops)}"),
    ]


def stereo(data: Path, folder: Path, report: Report) -> None:
    """Visual odometry of all frames; odd frames in the map of the even ones."""
    for name, frames in (("all", "0:51"), ("even", "0:51:2"), ("odd", "1:51:2")):
        call("import", "kitti", data, "-o", folder / name, "--frames", frames)
    call("map", folder / "all", "-o", folder / "all_map", "--anchor", "truth", "--trajectory", folder / "all.tum")
    call("map", folder / "even", "-o", folder / "map", "--anchor", "truth")
    topics = ("--image", "left/image_raw", "--info", "left/camera_info")
    call("localize", folder / "map", folder / "odd", "-o", folder / "odd.tum", *topics)
    truth, odd = read_poses(folder / "all", TRUTH), read_tum(folder / "odd.tum")
    travelled = read_tum(folder / "all.tum")
    placed = f"{len(travelled)} of {len(truth)} frames placed, {len(odd)} of 25 odd ones localised"
    report.notes.append(f"kitti_06: {placed}. Its truth turns by half a degree in the first {STEADY} frames.")
    aligned = evaluate_poses(odd, truth, alignment="se3").report["translation_m"]["median"] if len(odd) else np.nan
    steady = drift(travelled, truth, STEADY)
    of = Headline(POSE, "kitti_06, odd frames in a map of even ones")
    report.bounds += [
        Bound("kitti_06: visual odometry, error at the end over the way", 0.75, drift(travelled, truth), "%"),
        Bound(f"kitti_06: the same from frame {STEADY} on", 0.75, steady, "%", headline=Headline(MAP, "kitti_06")),
        Bound("kitti_06: odd frames by the left image, median error", 5.0, 1e2 * np.median(errors(odd, truth)), "cm"),
        Bound("kitti_06: odd frames by the left image, aligned, median", 5.0, 1e2 * aligned, "cm", headline=of),
    ]
