"""One drive with its camera upright, pitched by 30 degrees, rolled by 90 degrees and upside down: all must be the same.

In the town of the simulator an RGB-D camera teaches a path, `sphere_nav map` makes the map, and the car drives the path
again by the same camera. The first mounting teaches once more with other noise, and every taught path is compared with
where the car truly was: so noise, mounting and drift are told apart. Of redkitchen the images are turned, so that every
drive has the very same pixels; from a map of every third frame of 0:118 the 78 others are localised, each from nowhere,
turned by 0, 90, 180 and 270 degrees, and by a localiser that is not told so.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from benchmarks.end_to_end import call
from benchmarks.long_drive import STEP_NS, Taught, drive
from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import COLMAP_POSES, colmap_poses
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav.ros.camera.images import read_gray
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_from_info,
    camera_to_info,
    image_to_array,
    se3_to_transform,
    stamp_ns,
)
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.demo.demo import MOUNTINGS
from sphere_nav_tools.cli.demo.report import distances_from_path
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "the same drive with four mountings: taught paths, drives in the simulator, starts from nowhere"
SIMULATION = {"seed": 3, "path": "two_turns", "camera.period": 0.2}
WIDTH, ASPECT = 320, 0.75  # px of the camera; its height by its width
STILL = {"sphere.width": 0, "traffic.density": "none"}
WAY_M, QUICK_WAY_M, SPACING_M = 8.0, 4.0, 0.25  # that is taught; between two images
IMAGE_NOISE, DEPTH_NOISE = 1.5, 0.002  # grey levels; share of the depth
SAME_MM, SAME_DEG = 5.0, 0.1  # between the taught paths of two mountings
MAX_LATERAL_CM = 10.0
FRAME = "camera_optical"
FRAMES, MAPPED = "0:118", "0:118:3"
FOUND_M, FOUND_DEG = 0.1, 5.0  # of a start
QUICK_STEP = 6  # of the frames that are localised
NUM_QUARTERS = 4
OTHER_NOISE = 1  # seed of the noise of the drive that is taught again


@dataclass(frozen=True)
class Teaching:
    """Where the car truly went (N, 2) m, and the true poses of `base_link` at the images, the first as the origin."""

    way: NDArray[np.float64]
    poses: Trajectory


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--kitchen", type=Path, default=Path("../shared/data/rgbd/redkitchen"), help="7-Scenes folder")
    parser.add_argument("--mountings", nargs="+", choices=tuple(MOUNTINGS), default=tuple(MOUNTINGS), help="(all)")
    parser.add_argument("--width", type=int, default=WIDTH, help="px of the camera in the town (%(default)s)")
    parser.add_argument("--noise", type=float, default=1.0, help="of image and range, times the usual (%(default)s)")
    parser.add_argument("--only-taught", action="store_true", help="neither drive nor start from nowhere")


def run(options: argparse.Namespace) -> Report:
    """Teach, compare, drive, start."""
    report = Report("mounting", notes=[describe(options.threads), __doc__ or ""])
    with tempfile.TemporaryDirectory() as folder:
        drive_town(report, Path(folder), options)
    if options.only_taught:
        return report
    if colmap_poses(options.kitchen) is None:
        report.notes.append(f"redkitchen: skipped, no folder {options.kitchen}{COLMAP_POSES}")
        return report
    with tempfile.TemporaryDirectory() as folder:
        start_in_kitchen(report, options.kitchen, Path(folder), QUICK_STEP if options.quick else 1)
    return report


# --- the town
def drive_town(report: Report, folder: Path, options: argparse.Namespace) -> None:
    """Teach, map and drive with every mounting; compare the taught paths with the first one, and with the truth."""
    rows, names = list[tuple[str, ...]](), options.mountings
    taught, teaching = teach_and_map(folder / "other", names[0], options, OTHER_NOISE)
    other, off_truth = taught, compare(taught, teaching.poses)
    first: Trajectory | None = None
    for name in names:
        taught, teaching = teach_and_map(folder / name, name, options, 0)
        if first is None:
            first = taught
            noise = compare(other, first)
            rows.append((f"{name}, other noise", *words(noise), words(off_truth)[0], "", ""))
        off, off_truth = compare(taught, first), compare(taught, teaching.poses)
        if taught is not first:
            report.bounds += [
                Bound(f"town, taught path {name} and {names[0]}, largest distance", SAME_MM, off[0], "mm"),
                Bound(f"town, taught path {name} and {names[0]}, largest turn", SAME_DEG, off[1], "deg"),
            ]
        driven = ("", "")
        if not options.only_taught:
            driven = drive_again(report, folder / name, name, options, taught, teaching.way)
        rows.append((name, *words(off), words(off_truth)[0], *driven))
    columns = ("camera", "taught path off the first", "turned", "off the truth", "driven, lateral", "end")
    title = f"Taught and driven in the town, {way_length(options):g} m, {options.width} px, noise {options.noise:g}"
    report.tables.append(Table(title, columns, rows))


def words(off: tuple[float, float]) -> tuple[str, str]:
    """Return a distance in mm and a turn in deg as they are printed."""
    return f"{off[0]:.1f} mm", f"{off[1]:.2f} deg"


def way_length(options: argparse.Namespace) -> float:
    """Return the metres that are taught."""
    return QUICK_WAY_M if options.quick else WAY_M


def simulate(mounting: str, mode: str, options: argparse.Namespace) -> Simulator:
    """Return the town with a car whose camera sits so."""
    size = {"camera.size": f"{options.width},{round(ASPECT * options.width)}"}
    return Simulator(build(SimParams, SIMULATION | size | STILL | MOUNTINGS[mounting] | {"mode": mode}))


def teach_and_map(
    folder: Path, mounting: str, options: argparse.Namespace, noise_seed: int
) -> tuple[Trajectory, Teaching]:
    """Return the taught path, and the truth; the map is folder/map."""
    folder.mkdir()
    teaching = teach(folder / "bag", simulate(mounting, "teach", options), options, noise_seed)
    call("map", folder / "bag", "-o", folder / "map", "--taught", folder / "path.tum")
    return read_tum(folder / "path.tum"), teaching


def drive_again(
    report: Report,
    folder: Path,
    name: str,
    options: argparse.Namespace,
    taught: Trajectory,
    truth: NDArray[np.float64],
) -> tuple[str, str]:
    """Drive a taught path in its map; return the largest lateral error and how it ended."""
    with open_map(folder / "map") as sphere_map:
        path_taught = Taught(SphereGraph(), taught.stamps_ns, taught.T_map_body, truth, 0)
        driven = drive(simulate(name, "drive", options), path_taught, sphere_map)
    along, lateral = distances_from_path(driven.truth, truth)
    worst = 100 * float(np.abs(lateral).max())
    length = float(np.linalg.norm(np.diff(truth, axis=0), axis=1).sum())
    report.bounds += [
        Bound(f"town, driven {name}, largest lateral error", MAX_LATERAL_CM, worst, "cm"),
        Bound(f"town, driven {name}, share", 0.95, float(along.max()) / length, "", is_minimum=True),
    ]
    return f"{worst:.1f} cm", driven.end


def teach(path: Path, simulator: Simulator, options: argparse.Namespace, noise_seed: int) -> Teaching:
    """Write the bag of a teaching drive with an RGB-D camera; return where the car truly went."""
    mount, way, next_m = simulator.mounts["camera"], [], 0.0
    stamps, poses = list[int](), list[NDArray[np.float64]]()
    assert isinstance(mount.camera, Pinhole)
    z_of_ray, rng = pixel_rays(mount.camera)[..., 2], np.random.default_rng(noise_seed)
    image_noise, depth_noise = options.noise * IMAGE_NOISE, options.noise * DEPTH_NOISE
    with BagWriter(path) as bag:
        bag.add_topic("/tf_static", TFMessage, qos.LATCHED)
        place = se3_to_transform(mount.T_base_camera, simulator.time_ns, "base_link", FRAME)
        bag.write("/tf_static", TFMessage(transforms=[place]), simulator.time_ns)
        while simulator.driver.distance < way_length(options):
            if simulator.driver.distance >= next_m:
                next_m += SPACING_M
                image, range_m = simulator.render(mount.camera, simulator.T_world_base @ mount.T_base_camera, True)
                image = np.clip(np.rint(image + image_noise * rng.standard_normal(image.shape)), 1, 255)
                depth_m = range_m * z_of_ray * (1.0 + depth_noise * rng.standard_normal(image.shape))
                stamp = simulator.time_ns
                write(bag, "/camera_info", camera_to_info(mount.camera, stamp, FRAME), stamp)
                write(bag, "/depth/image_raw", array_to_image(depth_m.astype(np.float32), stamp, FRAME, "32FC1"), stamp)
                write(bag, "/image_raw", array_to_image(image.astype(np.uint8), stamp, FRAME, "mono8"), stamp)
                stamps.append(stamp)
                poses.append(simulator.T_world_base.matrix)
            way.append((simulator.vehicle.state.x, simulator.vehicle.state.y))
            simulator.step(simulator.teach_command(), STEP_NS)
    T_world_base, xy = SE3(np.array(poses)), np.array(way)
    is_new = np.append(True, np.any(np.diff(xy, axis=0) != 0.0, axis=1))
    return Teaching(xy[is_new], Trajectory(np.array(stamps), T_world_base[0].inverse() @ T_world_base))


def write(bag: BagWriter, topic: str, message: Any, stamp: int) -> None:
    """Write one message."""
    bag.add_topic(topic, type(message), qos.STATE)
    bag.write(topic, message, stamp)


def compare(one: Trajectory, other: Trajectory) -> tuple[float, float]:
    """Return the largest distance in mm and turn in deg of poses of the same stamps; NaN where some are missing."""
    if not np.array_equal(one.stamps_ns, other.stamps_ns):
        return np.nan, np.nan
    distances, angles = one.T_map_body.distance(other.T_map_body)
    return 1e3 * float(np.max(distances)), float(np.degrees(np.max(angles)))


# --- the kitchen
def start_in_kitchen(report: Report, data: Path, folder: Path, step: int) -> None:
    """Map the kitchen with the images turned each way; localise turned images in the upright map, from nowhere.

    The rolling shutter of turned images runs another way: they are mapped as of a global one.
    """
    poses, paths = ("--poses", colmap_poses(data), "--truth-camera", "colour"), []
    call("import", "seven_scenes", data, "-o", folder / "all", "--frames", FRAMES, *poses)
    call("import", "seven_scenes", data, "-o", folder / "turned_0", "--frames", MAPPED, *poses)
    for quarters in range(NUM_QUARTERS):
        bag, path = folder / f"turned_{quarters}", folder / f"{quarters}.tum"
        if quarters:
            turn_bag(folder / "turned_0", bag, quarters)
        call("map", bag, "-o", folder / f"map_{quarters}", "--taught", path)
        paths.append(read_tum(path))
        if quarters:
            off = compare(paths[-1], paths[0])
            report.bounds += [
                Bound(f"redkitchen, path of images turned by {90 * quarters} deg, distance", SAME_MM, off[0], "mm"),
                Bound(f"redkitchen, path of images turned by {90 * quarters} deg, turn", SAME_DEG, off[1], "deg"),
            ]
    call("map", folder / "turned_0", "-o", folder / "map", "--anchor", "truth")
    truth, mapped = read_poses(folder / "all", ("ground_truth/pose",)), set(paths[0].stamps_ns.tolist())
    with open_map(folder / "map", is_gray=True) as sphere_map, BagReader(folder / "all") as drives:
        localizer = Localizer(LocalizerParams(), sphere_map)
        camera = camera_from_info(next(iter(drives.messages(["/camera_info"]))).message)
        assert isinstance(camera, Pinhole)
        images = [item.message for item in drives.messages(["/image_raw"])]
        others = [one for one in images if stamp_ns(one) not in mapped][::step]
        for quarters in range(NUM_QUARTERS):
            found = [start(localizer, one, camera, truth, quarters) for one in others]
            what = f"redkitchen, starts of {len(others)} images turned by {90 * quarters} deg"
            report.bounds += [
                Bound(f"{what}, found", 0.95 * len(others), float(found.count(True)), "images", is_minimum=True),
                Bound(f"{what}, elsewhere", 0.0, float(found.count(False)), "images"),
            ]
        localizer.references.close()


def start(localizer: Localizer, message: Image, camera: Pinhole, truth: Trajectory, quarters: int) -> bool | None:
    """Localise one image from nowhere; return whether that is right, None where it is not found."""
    stamp = stamp_ns(message)
    localizer.reset()
    image = np.ascontiguousarray(np.rot90(read_gray(message, (camera.width, camera.height)), quarters))
    candidate = localizer.update(image, turn_camera(camera, quarters), stamp).candidate
    if candidate is None or not candidate.acceptance.is_good:
        return None
    at, _ = truth.at([stamp])
    T_map_camera = at.T_map_body[0] @ T_BODY_OPTICAL @ turn_axes(quarters)
    distance, angle = candidate.T_map_camera.distance(T_map_camera)
    return bool(distance < FOUND_M and angle < np.radians(FOUND_DEG))


def turn_bag(source: Path, target: Path, quarters: int) -> None:
    """Write a bag as a camera would that is turned about its axis, /tf_static included, as `np.rot90` turns images."""
    with BagReader(source) as bag, BagWriter(target) as turned:
        for item in bag.messages():
            message: Any = item.message
            if isinstance(message, TFMessage):
                frames = [one.child_frame_id for one in message.transforms]
                message.transforms += list(turned_frames(frames, item.stamp_ns, quarters))
            elif isinstance(message, CameraInfo):
                lens = camera_from_info(message)
                assert isinstance(lens, Pinhole)
                message = camera_to_info(turn_camera(lens, quarters), stamp_ns(message), turned_name(message))
            elif isinstance(message, Image):
                image = np.ascontiguousarray(np.rot90(image_to_array(message), quarters))
                message = array_to_image(image, stamp_ns(message), turned_name(message), message.encoding)
            profile = qos.LATCHED if isinstance(message, TFMessage) else qos.STATE
            turned.add_topic(item.topic, type(message), profile)
            turned.write(item.topic, message, item.stamp_ns)


def turned_name(message: Any) -> str:
    """Return the frame of a camera that is turned."""
    return f"{message.header.frame_id}_turned"


def turned_frames(frames: list[str], stamp: int, quarters: int) -> Iterator[Any]:
    """Yield where turned cameras are in the frames of those that are not."""
    for frame in frames:
        yield se3_to_transform(turn_axes(quarters), stamp, frame, f"{frame}_turned")


def turn_axes(quarters: int) -> SE3:
    """Return T_camera_turned: the image's new right is its old down, a quarter against the clock."""
    return SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.5 * np.pi * quarters])


def turn_camera(camera: Pinhole, quarters: int) -> Pinhole:
    """Return the lens of images turned by `np.rot90`; it has no distortion."""
    fx, fy, cx, cy, width, height = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    for _ in range(quarters):
        fx, fy, cx, cy, width, height = fy, fx, cy, width - 1 - cx, height, width
    return Pinhole(width, height, fx, fy, cx, cy)
