"""Recordings from end to end through the commands: import, map, localise, register, against their truth."""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.depth_icp import icp
from benchmarks.machine import describe
from benchmarks.report import Bound, Report
from benchmarks.rgbd_data import COLMAP_POSES, colmap_poses
from benchmarks.straight_truth import straighten
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import camera_from_info, depth_to_meters, message_to_status, stamp_ns
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.main import main as sphere_nav
from sphere_nav_tools.offline.evaluation import evaluate_poses
from sphere_nav_tools.offline.mapping.drive import fit_poses
from sphere_nav_tools.offline.mapping.sphere_source import LensOptions, read_sphere
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "import, map, localise and register recorded data through the commands"
TRUTH = ("ground_truth/pose",)
MIN_OVERLAP = 0.3  # of the depth points of an image, by the true poses, that a mapped image sees
STEP = 16  # px between two of those points
HELD_OUT, LONG, INTERLEAVED = (8.0, 0.4), (15.0, 0.4), (2.5, 0.1)  # mm, deg: medians
LONG_FRAMES = 240  # localised from where on a split is a long one
KITCHEN = ("0:120/120:240", "0:240:2/1:240:2")  # mapped/localised
OTHERS = ("300:420/420:460", "300:420/500:540", "300:420/700:740", "240:700/700:999", "300:540:2/301:540:2")
ANCHORS = ("truth", "survey")
NEES = 0.5, 2.0  # least and largest mean, over 6 degrees of freedom
FALSE_LOOP = 0.1, 2.0  # m, deg off the truth
READOUT_S = 0.0227  # 0.68 of a frame, measured beside COLMAP's poses
KITCHEN_READOUT = f"camera.readout={READOUT_S}"
STEADY = 12  # frames of kitti_06 after which its truth turns as its left image says
MAPPED_STEP = 6  # of the mapped images that are asked, every so many

Row = Callable[[Path, Path, Report, argparse.Namespace], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "--recordings", type=Path, default=Path("../shared/data"), help="folder with rgbd, driving and rgbd_spheres"
    )
    held_out = " ".join(OTHERS)
    told = f"frames of redkitchen only, mapped/localised; without any: {' '.join(KITCHEN)}, and held out {held_out}"
    parser.add_argument("--kitchens", nargs="*", metavar="A:B/C:D", default=None, help=told)
    parser.add_argument("--anchors", nargs="+", choices=ANCHORS, default=ANCHORS[:1], help="of their maps (truth)")


def run(options: argparse.Namespace) -> Report:
    """Measure what is there."""
    report = Report("end_to_end", notes=[describe(options.threads)])
    rows: dict[str, Row] = {"rgbd_spheres": spheres, "driving/kitti_06": stereo, "rgbd/redkitchen": kitchen}
    if options.kitchens is not None:
        rows = {"rgbd/redkitchen": kitchen}
    for name, row in rows.items():
        if not (options.recordings / name).is_dir():
            report.notes.append(f"{name}: skipped, no folder {options.recordings / name}")
            continue
        with tempfile.TemporaryDirectory() as folder:
            row(options.recordings / name, Path(folder), report, options)
    if not report.bounds:
        report.skipped = f"no recordings in {options.recordings}"
    return report


def kitchen(data: Path, folder: Path, report: Report, options: argparse.Namespace) -> None:
    """RGB-D frames mapped, others localised from colour alone, judged by COLMAP: the recorded poses are wrong."""
    poses = colmap_poses(data)
    if poses is None:
        report.notes.append(f"redkitchen: skipped, no folder {data}{COLMAP_POSES}")
        return
    for text in options.kitchens or (*KITCHEN, *(OTHERS if options.kitchens is not None else ())):
        split, part = Split.read(text), folder / text.replace(":", "_").replace("/", "_in_")
        if missing := split.missing(poses):
            report.notes.append(f"redkitchen {split}: skipped, no {missing.name} in {poses}")
            continue
        truth_of = ("--poses", poses, "--truth-camera", "colour")
        for bag, frames in (("taught", split.mapped), ("driven", split.localised)):
            call("import", "seven_scenes", data, "-o", part / bag, "--frames", frames, *truth_of)
        stamps = overlapping(part / "taught", part / "driven")
        for anchor in options.anchors:
            judge_split(split, part, anchor, stamps, report)


@dataclass(frozen=True)
class Split:
    """Frames mapped and frames localised, each as `sphere_nav import --frames` has them; bound in mm and degrees."""

    mapped: str
    localised: str

    @classmethod
    def read(cls, text: str) -> Split:
        """Return a split written A:B[:STEP]/C:D[:STEP]; ValueError names what is not one."""
        parts = text.split("/")
        if len(parts) != 2 or not all(re.fullmatch(r"\d+:\d+(:[1-9]\d*)?", part) for part in parts):
            raise ValueError(f"--kitchens: expected A:B[:STEP]/C:D[:STEP], found {text}")
        return cls(*parts)

    def __str__(self) -> str:
        is_odd = self.localised.startswith("1:") and self.mapped.startswith("0:") and self.is_interleaved
        return "odd in even frames" if is_odd else f"{self.localised} in {self.mapped}"

    @property
    def is_interleaved(self) -> bool:
        """Whether the localised frames are between the mapped ones."""
        mapped, localised = frame_numbers(self.mapped), frame_numbers(self.localised)
        return mapped.start < localised.start < mapped.stop

    @property
    def bound(self) -> tuple[float, float]:
        """The bounds of the medians, mm and degrees."""
        if self.is_interleaved:
            return INTERLEAVED
        return LONG if len(frame_numbers(self.localised)) >= LONG_FRAMES else HELD_OUT

    def missing(self, poses: Path) -> Path | None:
        """Return the last pose of either part where the recording has not got that far."""
        last = max(frame_numbers(part)[-1] for part in (self.mapped, self.localised))
        path = poses / f"frame-{last:06d}.pose.txt"
        return None if path.exists() else path


def frame_numbers(frames: str) -> range:
    """Return the numbers that A:B[:STEP] names."""
    return range(*[int(word) for word in frames.split(":")])


def judge_split(split: Split, part: Path, anchor: str, stamps: Sequence[int], report: Report) -> None:
    """Map and localise one split with one anchor; add its bounds."""
    taught, driven, made, path = part / "taught", part / "driven", part / f"map_{anchor}", part / f"poses_{anchor}.tum"
    what = f"{split}" if anchor == "truth" else f"{split}, {anchor}"
    readout = ("--set", KITCHEN_READOUT)
    call("map", taught, "-o", made, "--anchor", anchor, *readout, "--trajectory", part / f"map_{anchor}.tum")
    if anchor == "truth":
        judge_map(f"redkitchen map of {split.mapped}", taught, part, report)
    call("localize", made, driven, "-o", path, "--bag", part / f"said_{anchor}", *readout)
    truth, estimate = read_poses(driven, TRUTH), read_tum(path)
    seen = estimate[np.isin(estimate.stamps_ns, stamps)]
    judged, bound = evaluate_poses(seen, truth).report, split.bound
    false_fixes = float(np.sum(errors(tracked(part / f"said_{anchor}", estimate), truth) > 0.15))
    with_covariance = read_poses(part / f"said_{anchor}", ("pose",))
    share = len(seen) / max(len(stamps), 1)
    report.notes.append(
        f"redkitchen {what}: {len(stamps)} of {len(truth)} images overlap the map by {MIN_OVERLAP:.0%}; NEES of x, y, "
        f"z, roll, pitch, yaw {nees_of_each_axis(with_covariance, truth)}"
    )
    report.bounds += [
        Bound(f"redkitchen {what} by colour, median", bound[0], 1e3 * judged["translation_m"]["median"], "mm"),
        Bound(f"redkitchen {what} by colour, median turn", bound[1], judged["rotation_deg"]["median"], "deg"),
        *nees_bounds(f"redkitchen {what}", with_covariance, truth),
        Bound(f"redkitchen {what}, TRACKING with an error over 0.15 m", 0.0, false_fixes, "images"),
        Bound(f"redkitchen {what}, overlapping images with a pose", 0.5, share, "", is_minimum=True),
    ]
    by = f"redkitchen {what} by colour, COLMAP's poses straightened"
    straight, T_truth_map = straight_truth(taught, driven, part / f"map_{anchor}.tum")
    judged = evaluate_poses(seen.moved(T_truth_map), straight).report
    report.bounds += [
        Bound(f"{by}, median", bound[0], 1e3 * judged["translation_m"]["median"], "mm"),
        Bound(f"{by}, median turn", bound[1], judged["rotation_deg"]["median"], "deg"),
        *nees_bounds(by, with_covariance.moved(T_truth_map), straight),
    ]


def nees_bounds(what: str, estimate: Trajectory, truth: Trajectory) -> list[Bound]:
    """Return both bounds of the mean NEES over its six degrees of freedom."""
    told = evaluate_poses(estimate, truth).report["nees"]
    nees, (least, most) = told["mean"] / 6 if told else np.nan, NEES
    return [
        Bound(f"{what}, mean NEES over 6, not less than", least, nees, "", is_minimum=True),
        Bound(f"{what}, mean NEES over 6, not more than", most, nees, ""),
    ]


def nees_of_each_axis(estimate: Trajectory, truth: Trajectory) -> str:
    """Return the mean NEES of each axis of the body, 1 where its deviation is honest."""
    told = evaluate_poses(estimate, truth).report["nees"]
    return ", ".join(f"{value:.2f}" for value in told["axes"].values()) if told else "unknown"


def straight_truth(taught: Path, driven: Path, way: Path) -> tuple[Trajectory, SE3]:
    """Return the driven truth less what a rolling shutter does to poses by a global one, and the map fitted to it."""
    straight = [straighten(bag, read_poses(bag, TRUTH), READOUT_S) for bag in (taught, driven)]
    mapped = read_tum(way)
    at, known = straight[0].at(mapped.stamps_ns, max_gap_ns=10**9)
    return straight[1], fit_poses(at.T_map_body, mapped.T_map_body[known])


def judge_map(what: str, taught: Path, part: Path, report: Report) -> None:
    """Add how right the poses of all mapped frames are, and which of its loops join what is not together."""
    truth = read_poses(taught, TRUTH)
    with open_map(part / "map_truth") as reader:
        graph = reader.graph
    at, known = truth.at([node.stamp_ns for node in graph], max_gap_ns=10**9)
    ids = np.array(list(graph.nodes))[known].tolist()
    true = {node_id: at.T_map_body[index] for index, node_id in enumerate(ids)}
    loops = [edge for edge in graph.edges if edge.is_loop and edge.a in true and edge.b in true]
    off = [(true[edge.a].inverse() @ true[edge.b]).distance(edge.T_a_b) for edge in loops]
    false = sum(moved > FALSE_LOOP[0] or turned > np.radians(FALSE_LOOP[1]) for moved, turned in off)
    error = evaluate_poses(read_tum(part / "map_truth.tum"), truth).report["translation_m"]
    report.notes.append(f"{what}: {len(graph)} key spheres, {len(loops)} loops")
    report.bounds += [
        Bound(f"{what}, poses of its frames, median", 10.0, 1e3 * error["median"], "mm"),
        Bound(f"{what}, poses of its frames, largest", 50.0, 1e3 * error["max"], "mm"),
        Bound(f"{what}, false loops", 0.0, float(false), f"of {len(loops)}"),
    ]


def stereo(data: Path, folder: Path, report: Report, _: argparse.Namespace) -> None:
    """Visual odometry of all frames; odd frames in the map of the even ones."""
    for name, frames in (("all", "0:51"), ("even", "0:51:2"), ("odd", "1:51:2")):
        call("import", "kitti", data, "-o", folder / name, "--frames", frames)
    call("map", folder / "all", "-o", folder / "all_map", "--anchor", "truth", "--trajectory", folder / "all.tum")
    call("map", folder / "even", "-o", folder / "map", "--anchor", "truth")
    topics = ("--image", "left/image_raw", "--info", "left/camera_info")
    call("localize", folder / "map", folder / "odd", "-o", folder / "odd.tum", *topics)
    truth, odd = read_poses(folder / "all", TRUTH), read_tum(folder / "odd.tum")
    travelled = read_tum(folder / "all.tum")
    report.notes.append(
        f"kitti_06: {len(travelled)} of {len(truth)} frames placed, {len(odd)} of 25 odd ones localised. Its truth"
        f" turns by half a degree in the first {STEADY} frames, which neither the left image alone nor the pair sees."
    )
    aligned = evaluate_poses(odd, truth, alignment="se3").report["translation_m"]["median"] if len(odd) else np.nan
    whole, steady = (drift(travelled, truth, first) for first in (0, STEADY))
    report.bounds += [
        Bound("kitti_06 visual odometry, error at the end over distance", 0.75, whole, "%"),
        Bound(f"kitti_06 visual odometry from frame {STEADY} on, error at the end over distance", 0.75, steady, "%"),
        Bound("kitti_06 odd frames by the left image, median", 5.0, 1e2 * float(np.median(errors(odd, truth))), "cm"),
        Bound("kitti_06 odd frames by the left image, positions aligned, median", 5.0, 1e2 * aligned, "cm"),
    ]


def drift(travelled: Trajectory, truth: Trajectory, first: int) -> float:
    """Return the error at the end in per cent of the way since a frame, whose pose is taken from the truth."""
    at, _ = truth.at(travelled.stamps_ns, max_gap_ns=10**9)
    T_start = at.T_map_body[first] @ travelled.T_map_body[first].inverse()
    off = at.T_map_body[-1].distance(T_start @ travelled.T_map_body[-1])[0]
    return 100 * float(off / (truth.distances[-1] - truth.distances[first]))


def spheres(data: Path, folder: Path, report: Report, _: argparse.Namespace) -> None:
    """Two RGB-D spheres registered from identity."""
    call("import", "spherical", data, "-o", folder / "bag")
    call("register", f"{folder / 'bag'}:0", f"{folder / 'bag'}:1", "--json", folder / "found.json")
    found = json.loads((folder / "found.json").read_text())
    reference = read_poses(folder / "bag", TRUTH).T_map_body
    T_reference = reference[0].inverse() @ reference[1]
    T_a_b = SE3(np.array(found["T_a_b"]["matrix"]))
    moved, turned = T_reference.distance(T_a_b)
    a, b = (read_sphere(f"{folder / 'bag'}:{number}", LensOptions(), MapperParams()) for number in (0, 1))
    by_depth = icp(a, b, T_reference)
    left = 100 * float(by_depth.distance(T_reference)[0])
    report.notes.append(f"rgbd_spheres: ICP of the depth alone, begun at the reference, ends {left:.1f} cm off it.")
    before, after = found["residual_at_guess"]["mad"], found["residual"]["mad"]
    report.bounds += [
        Bound("rgbd_spheres from identity, off the reference", 5.0, 1e2 * float(moved), "cm"),
        Bound("rgbd_spheres from identity, off the depth alone", 2.0, 1e2 * float(by_depth.distance(T_a_b)[0]), "cm"),
        Bound("rgbd_spheres from identity, turn off the reference", 0.6, float(np.degrees(turned)), "deg"),
        Bound(f"rgbd_spheres, MAD {before:.1f} -> {after:.1f}, after over before", 0.9, after / before, ""),
    ]


def call(*words: object) -> None:
    """Run a command; ValueError with what it said where it fails."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            status: object = sphere_nav([str(word) for word in words])
        except SystemExit as misuse:  # of argparse, which has written why
            status = misuse.code or 0
    if status != 0:
        lines = said.getvalue().strip().splitlines() or [""]
        raise ValueError(f"sphere_nav {words[0]}: expected status 0, found {status}: {lines[-1]}")


def errors(estimate: Trajectory, truth: Trajectory) -> NDArray[np.float64]:
    """Return the distance in m of every pose from the truth at its stamp, of those that have one."""
    return evaluate_poses(estimate, truth).errors.translation_m if len(estimate) else np.full(1, np.nan)


def tracked(said: Path, estimate: Trajectory) -> Trajectory:
    """Return the poses whose status is TRACKING."""
    with BagReader(said) as bag:
        messages = [item.message for item in bag.messages(["/status"])]
    stamps = [stamp_ns(message) for message in messages if message_to_status(message).state == "TRACKING"]
    return estimate[np.isin(estimate.stamps_ns, stamps)]


def overlapping(taught: Path, driven: Path) -> Sequence[int]:
    """Return the stamps of the driven images of which the taught ones see enough."""
    mapped = read_poses(taught, TRUTH).T_map_body
    optical = T_BODY_OPTICAL
    truth = read_poses(driven, TRUTH)
    poses = dict(zip(truth.stamps_ns.tolist(), (truth.T_map_body[i] @ optical for i in range(len(truth))), strict=True))
    views = [mapped[i] @ optical for i in range(0, len(mapped.matrix), MAPPED_STEP)]
    found: list[int] = []
    with BagReader(driven) as bag:
        camera: Camera = camera_from_info(next(bag.messages(["/camera_info"])).message)
        rays = camera.unproject(pixel_grid(camera)[::STEP, ::STEP])
        for _, _, message in bag.messages(["/depth/image_raw"]):
            stamp = stamp_ns(message)
            depth = depth_to_meters(message)[::STEP, ::STEP]
            points_map = poses[stamp].apply((rays / rays[..., 2:] * depth[..., None])[np.isfinite(depth)])
            if max(share_seen(camera, view.inverse().apply(points_map)) for view in views) >= MIN_OVERLAP:
                found.append(stamp)
    return found


def share_seen(camera: Camera, points_camera: NDArray[np.float64]) -> float:
    """Return the share of points (N, 3) that fall into the image."""
    pixels, is_ahead = camera.project(points_camera)
    inside = is_ahead & np.all((pixels >= 0) & (pixels <= [camera.width - 1, camera.height - 1]), axis=-1)
    return float(inside.sum()) / max(len(points_camera), 1)
