"""Recordings from end to end through the commands: import, map, localise, register, against their truth."""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.depth_icp import icp
from benchmarks.machine import describe
from benchmarks.report import Bound, Report
from benchmarks.rgbd_data import COLMAP_POSES, colmap_poses
from benchmarks.straight_truth import straighten
from sphere_mapping.params import MapperParams
from sphere_nav.cli.main import main as sphere_nav
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.offline.evaluation import evaluate_poses
from sphere_nav.offline.mapping.drive import fit_poses
from sphere_nav.offline.mapping.sphere_source import LensOptions, read_sphere
from sphere_nav.offline.pose_bags import read_poses
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import camera_from_info, depth_to_meters, message_to_status, stamp_ns
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

HELP = "import, map, localise and register recorded data through the commands"
TRUTH = ("ground_truth/pose",)
MIN_OVERLAP = 0.3  # of the depth points of an image, by the true poses, that a mapped image sees
STEP = 16  # px between two of those points
KITCHEN = (  # what, frames mapped, frames localised, bounds in mm and degrees
    ("120:240 in 0:120", "0:120", "120:240", (8.0, 0.4)),
    ("odd in even frames", "0:240:2", "1:240:2", (2.5, 0.1)),
)
FALSE_LOOP = 0.1, 2.0  # m, deg off the truth
READOUT_S = 0.0227  # 0.68 of a frame, measured beside COLMAP's poses
KITCHEN_READOUT = f"camera.readout={READOUT_S}"
STEADY = 12  # frames of kitti_06 after which its truth turns as its left image says
MAPPED_STEP = 6  # of the mapped images that are asked, every so many

Row = Callable[[Path, Path, Report], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "--recordings", type=Path, default=Path("../shared/data"), help="folder with rgbd, driving and rgbd_spheres"
    )


def run(options: argparse.Namespace) -> Report:
    """Measure what is there."""
    report = Report("end_to_end", notes=[describe(options.threads)])
    rows: dict[str, Row] = {"rgbd_spheres": spheres, "driving/kitti_06": stereo, "rgbd/redkitchen": kitchen}
    for name, row in rows.items():
        if not (options.recordings / name).is_dir():
            report.notes.append(f"{name}: skipped, no folder {options.recordings / name}")
            continue
        with tempfile.TemporaryDirectory() as folder:
            row(options.recordings / name, Path(folder), report)
    if not report.bounds:
        report.skipped = f"no recordings in {options.recordings}"
    return report


def kitchen(data: Path, folder: Path, report: Report) -> None:
    """RGB-D frames mapped, others localised from colour alone, judged by COLMAP: the recorded poses are wrong."""
    poses = colmap_poses(data)
    if poses is None:
        report.notes.append(f"redkitchen: skipped, no folder {data}{COLMAP_POSES}")
        return
    for what, mapped, localised, bound in KITCHEN:
        part = folder / mapped.replace(":", "_")
        taught, driven = part / "taught", part / "driven"
        for bag, frames in ((taught, mapped), (driven, localised)):
            truth_of = ("--poses", poses, "--truth-camera", "colour")
            call("import", "seven_scenes", data, "-o", bag, "--frames", frames, *truth_of)
        way = ("--trajectory", part / "map.tum")
        call("map", taught, "-o", part / "map", "--anchor", "truth", "--set", KITCHEN_READOUT, *way)
        judge_map(f"redkitchen map of {mapped}", taught, part, report)
        output = ("-o", part / "poses.tum", "--bag", part / "said")
        call("localize", part / "map", driven, *output, "--set", KITCHEN_READOUT)
        stamps = overlapping(taught, driven)
        truth, estimate = read_poses(driven, TRUTH), read_tum(part / "poses.tum")
        seen = estimate[np.isin(estimate.stamps_ns, stamps)]
        judged = evaluate_poses(seen, truth).report
        false_fixes = float(np.sum(errors(tracked(part / "said", estimate), truth) > 0.15))
        told = evaluate_poses(read_poses(part / "said", ("pose",)), truth).report["nees"]
        nees = told["mean"] / 6 if told else np.nan
        share = len(seen) / max(len(stamps), 1)
        report.notes.append(
            f"redkitchen {what}: {len(stamps)} of {len(truth)} images overlap the map by {MIN_OVERLAP:.0%}"
        )
        report.bounds += [
            Bound(f"redkitchen {what} by colour, median", bound[0], 1e3 * judged["translation_m"]["median"], "mm"),
            Bound(f"redkitchen {what} by colour, median turn", bound[1], judged["rotation_deg"]["median"], "deg"),
            Bound(f"redkitchen {what}, mean NEES over 6, not less than", 0.5, nees, "", is_minimum=True),
            Bound(f"redkitchen {what}, mean NEES over 6, not more than", 2.0, nees, ""),
            Bound(f"redkitchen {what}, TRACKING with an error over 0.15 m", 0.0, false_fixes, "images"),
            Bound(f"redkitchen {what}, overlapping images with a pose", 0.5, share, "", is_minimum=True),
        ]
        report.bounds += judge_straight(what, taught, driven, seen, bound)


def judge_straight(what: str, taught: Path, driven: Path, seen: Trajectory, bound: tuple[float, float]) -> list[Bound]:
    """Return the medians by the truth less what a rolling shutter does to poses by a global one, map fitted anew."""
    straight = [straighten(bag, read_poses(bag, TRUTH), READOUT_S) for bag in (taught, driven)]
    way = read_tum(taught.with_name("map.tum"))
    at, known = straight[0].at(way.stamps_ns, max_gap_ns=10**9)
    judged = evaluate_poses(seen.moved(fit_poses(at.T_map_body, way.T_map_body[known])), straight[1]).report
    by = f"redkitchen {what} by colour, COLMAP's poses straightened"
    return [
        Bound(f"{by}, median", bound[0], 1e3 * judged["translation_m"]["median"], "mm"),
        Bound(f"{by}, median turn", bound[1], judged["rotation_deg"]["median"], "deg"),
    ]


def judge_map(what: str, taught: Path, part: Path, report: Report) -> None:
    """Add how right the poses of all mapped frames are, and which of its loops join what is not together."""
    truth = read_poses(taught, TRUTH)
    with open_map(part / "map") as reader:
        graph = reader.graph
    at, known = truth.at([node.stamp_ns for node in graph], max_gap_ns=10**9)
    ids = np.array(list(graph.nodes))[known].tolist()
    true = {node_id: at.T_map_body[index] for index, node_id in enumerate(ids)}
    loops = [edge for edge in graph.edges if edge.is_loop and edge.a in true and edge.b in true]
    off = [(true[edge.a].inverse() @ true[edge.b]).distance(edge.T_a_b) for edge in loops]
    false = sum(moved > FALSE_LOOP[0] or turned > np.radians(FALSE_LOOP[1]) for moved, turned in off)
    error = evaluate_poses(read_tum(part / "map.tum"), truth).report["translation_m"]
    report.notes.append(f"{what}: {len(graph)} key spheres, {len(loops)} loops")
    report.bounds += [
        Bound(f"{what}, poses of its frames, median", 10.0, 1e3 * error["median"], "mm"),
        Bound(f"{what}, poses of its frames, largest", 50.0, 1e3 * error["max"], "mm"),
        Bound(f"{what}, false loops", 0.0, float(false), f"of {len(loops)}"),
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


def spheres(data: Path, folder: Path, report: Report) -> None:
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
