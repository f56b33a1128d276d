"""Several recordings of one place: the first is mapped, each other one localised, joined to the map, localised again.

`python -m benchmarks repeats DIR` takes a folder of bags, or of recordings that `sphere_nav import` knows by their
files (one kind: ROVER, 4Seasons, EuRoC, OpenLORIS, NCLT, TUM, KITTI), in the order of their names. With `--simulated N`
a way is taught in the simulator and repeated N times (`simulated_repeats.py`); without either a street of it is
recorded in several lights.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tf2_msgs.msg import TFMessage

from benchmarks.end_to_end import call, errors, tracked
from benchmarks.machine import describe
from benchmarks.mounting import DEPTH_NOISE, FRAME, STEP_NS, write
from benchmarks.report import Report, Table
from benchmarks.simulated_repeats import KINDS, Way, draw_drives, measure
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_mapping.experiences.budget import Budget
from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_pose_stamped, se3_to_transform
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.ros.tf import TransformTree
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.importing.frames import guess_format
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "recordings of one place on several days (DIR): map the first, localise and add the others"
CONDITIONS = ("", "overcast", "low_sun", "night_lamps")  # of the example, the first is mapped
SIMULATION = {
    "seed": 4, "path": "straight", "camera.size": "320,240", "sphere.width": 0,
    "traffic.density": "none", "render.shadow_texel": 0.16,
}  # fmt: skip
WAY_M, QUICK_WAY_M, SPACING_M = 20.0, 8.0, 0.25  # of the example, and between two of its images
TRUTHS = ("/ground_truth/odometry", "/ground_truth/pose")  # of the vehicle, of the camera
IMAGES = (
    "/image_raw",
    "/left/image_raw",
    "/cameras/cam5/image_raw",
)  # what is localised: the first of them that a bag has
COLUMNS = (
    "recording", "images", "TRACKING in the first map", "wrong", "median error", "map", "TRACKING then", "wrong",
    "median error",
)  # fmt: skip


@dataclass(frozen=True)
class Found:
    """A recording in a map: images in TRACKING, how many of those are wrong (NaN without truth), median error, m."""

    num_tracked: int
    num_wrong: float
    median_m: float

    def cells(self, num_images: int) -> tuple[str, str, str]:
        """Return them as they are printed."""
        if np.isnan(self.num_wrong):
            return f"{self.num_tracked / num_images:.1%}", "no truth", "-"
        error = "-" if np.isnan(self.median_m) else f"{1e3 * self.median_m:.1f} mm"
        return f"{self.num_tracked / num_images:.1%}", f"{self.num_wrong:.0f}", error


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--wrong", type=float, default=0.3, metavar="M", help="m off the truth that is wrong (0.3)")
    parser.add_argument(
        "--simulated", type=int, nargs="?", const=30, metavar="N", help="repeat a way of the simulator N times (30)"
    )
    parser.add_argument("--length", type=float, default=490.0, metavar="M", help="of that way, at most 490 (490)")
    parser.add_argument("--town", type=int, default=1, metavar="SEED", help="where that way is (1)")
    parser.add_argument(
        "--kinds", nargs="+", choices=("day", *KINDS[1:]), help="lights and seasons of the drives (all)"
    )
    parser.add_argument("--order", type=int, default=1, metavar="SEED", help="decides their order and clouds (1)")
    parser.add_argument("--driven", type=int, default=0, metavar="K", help="kinds driven over DDS at the end (0)")
    parser.add_argument("--budget", default="", metavar="N|MB", help="of the map, as `map --budget` (none)")
    parser.add_argument(
        "--repeats-folder", type=Path, metavar="DIR", help="keep the drives and go on with what is there"
    )


def run(options: argparse.Namespace) -> Report:
    """Measure the recordings of the folder that was named, or of the example."""
    folders = getattr(options, "folders", [])
    if len(folders) > 1:
        raise ValueError(f"repeats: expected one folder of recordings, found {len(folders)}")
    with tempfile.TemporaryDirectory() as name:
        work = options.repeats_folder or Path(name)
        if options.budget:
            Budget.parse(options.budget)  # a wrong one is refused before anything is driven
        if options.simulated:
            kinds = tuple("" if kind == "day" else kind for kind in options.kinds or KINDS)
            way = Way(options.town, options.length)
            drives = draw_drives(options.simulated, options.order, kinds)
            return measure(way, drives, work, options.budget, options.driven, options.threads)
        bags = find_recordings(folders[0], work) if folders else record_example(work, is_quick=options.quick)
        rows, notes = follow(bags, work, options.wrong)
    title = f"Repeats of {folders[0].name if folders else 'a simulated street'}"
    notes.append(f"wrong: TRACKING more than {options.wrong} m off the truth")
    return Report("repeats", [Table(title, COLUMNS, rows)], notes=[*notes, describe(options.threads)])


def find_recordings(folder: Path, work: Path) -> list[Path]:
    """Return the bags in a folder, in the order of their names; others are imported first."""
    found = []
    for path in sorted(folder.iterdir()):
        if (kind := guess_format(path) if path.is_dir() else "") and not (path / "metadata.yaml").is_file():
            call("import", kind, path, "-o", work / "imported" / path.name)
            found.append(work / "imported" / path.name)
        elif path.suffix in (".mcap", ".db3", ".bag") or (path / "metadata.yaml").is_file():
            found.append(path)
    if len(found) < 2:
        raise ValueError(f"{folder}: expected at least two bags or recordings of a known kind, found {len(found)}")
    return found


def follow(bags: Sequence[Path], work: Path, wrong_m: float) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return a row for each recording, and notes; the map grows by each that can be joined to it."""
    rows: list[tuple[str, ...]] = []
    notes: list[str] = []
    first = newest = work / "map_0"
    has_truth = true_poses(bags[0]) is not None
    call("map", bags[0], "-o", first, *(("--anchor", "truth") if has_truth else ()), *rig_options(bags[0]))
    rows.append((bags[0].stem, f"{_count(bags[0])}", "mapped", "", "", f"{_size(first)} key spheres", "", "", ""))
    for number, bag in enumerate(bags[1:], start=1):
        before = localise(first, bag, work / f"before_{number}", wrong_m)
        said = "refused"
        try:
            call("map", bag, "-o", work / f"map_{number}", "--extend", newest, *rig_options(bag))
            newest = work / f"map_{number}"
            said = f"{_size(newest)} key spheres"
        except ValueError as error:
            notes.append(f"{bag.stem} could not be joined: {error}")
        after = localise(newest, bag, work / f"after_{number}", wrong_m) if newest != first else before
        count = _count(bag)
        rows.append((bag.stem, f"{count}", *before.cells(count), said, *after.cells(count)))
    again = localise(newest, bags[0], work / "again", wrong_m)
    alone = localise(first, bags[0], work / "alone", wrong_m)
    count = _count(bags[0])
    rows.append((f"{bags[0].stem} again", f"{count}", *alone.cells(count), "", *again.cells(count)))
    return rows, notes


def rig_options(bag: Path) -> tuple[object, ...]:
    """Return what `sphere_nav map` needs of a bag with a rig (NCLT): its file, and that a LiDAR gives range."""
    rig = bag / "rig.yaml"
    return ("--rig", rig, "--set-stitcher", "has_cloud=true") if rig.is_file() else ()


def localise(map_folder: Path, bag: Path, folder: Path, wrong_m: float) -> Found:
    """Localise a recording by its image alone; an error where nothing was found is a result, too."""
    folder.mkdir()
    image = _image(bag)
    camera = (
        () if image == IMAGES[0] else ("--image", image[1:], "--info", f"{image[1:].rpartition('/')[0]}/camera_info")
    )
    try:
        call("localize", map_folder, bag, "-o", folder / "poses.tum", "--bag", folder / "said", *camera)
        poses = tracked(folder / "said", read_tum(folder / "poses.tum"))
    except ValueError:
        return Found(0, 0.0, float("nan"))
    return judge(poses, true_poses(bag), wrong_m)


def judge(poses: Trajectory, truth: Trajectory | None, wrong_m: float) -> Found:
    """Count the poses in TRACKING, and those of them that are wrong."""
    if truth is None:
        return Found(len(poses), float("nan"), float("nan"))
    if not len(poses):
        return Found(0, 0.0, float("nan"))
    off = errors(poses, truth)
    return Found(len(poses), float(np.sum(off > wrong_m)), float(np.median(off)))


def record_example(work: Path, *, is_quick: bool) -> list[Path]:
    """Record a street by an RGB-D camera in each of CONDITIONS; the same way, other noise."""
    bags = []
    for number, condition in enumerate(CONDITIONS):
        path = work / f"{number}_{condition or 'day'}"
        simulator = Simulator(build(SimParams, SIMULATION | {"condition": condition, "noise_seed": number + 1}))
        record(simulator, path, QUICK_WAY_M if is_quick else WAY_M)
        bags.append(path)
    return bags


def record(simulator: Simulator, path: Path, way_m: float) -> None:
    """Drive a way; write image, registered depth, camera_info and true pose every SPACING_M."""
    mount, next_m, number = simulator.mounts["camera"], 0.0, 0
    assert isinstance(mount.camera, Pinhole)
    z_of_ray, rng = pixel_rays(mount.camera)[..., 2], np.random.default_rng(simulator.params.noise_seed)
    T_base_body = mount.T_base_camera @ T_BODY_OPTICAL.inverse()
    with BagWriter(path) as bag:
        bag.add_topic("/tf_static", TFMessage, qos.LATCHED)
        place = se3_to_transform(mount.T_base_camera, simulator.time_ns, "base_link", FRAME)
        bag.write("/tf_static", TFMessage(transforms=[place]), simulator.time_ns)
        while simulator.driver.distance < way_m:
            if simulator.driver.distance >= next_m:
                next_m, number, stamp = next_m + SPACING_M, number + 1, simulator.time_ns
                frame = simulator.cameras.capture("camera", number, stamp)
                depth_m = frame.range_m * z_of_ray * (1.0 + DEPTH_NOISE * rng.standard_normal(frame.range_m.shape))
                truth = se3_to_pose_stamped(simulator.T_world_base @ T_base_body, stamp, "map")
                write(bag, "/ground_truth/pose", truth, stamp)
                write(bag, "/camera_info", camera_to_info(mount.camera, stamp, FRAME), stamp)
                write(bag, "/depth/image_raw", array_to_image(depth_m.astype(np.float32), stamp, FRAME, "32FC1"), stamp)
                write(bag, "/image_raw", array_to_image(frame.image, stamp, FRAME, "mono8"), stamp)
            simulator.step(simulator.teach_command(), STEP_NS)


def _image(bag: Path) -> str:
    """Return the topic of the images that are localised."""
    with BagReader(bag) as reader:
        return next((name for name in IMAGES if name in reader.topics and reader.topics[name].count), IMAGES[0])


def _count(bag: Path) -> int:
    with BagReader(bag) as reader:
        return reader.topics[_image(bag)].count if _image(bag) in reader.topics else 0


def true_poses(bag: Path) -> Trajectory | None:
    """Return where base_link truly was: what is localised; the truth of a camera is taken there by /tf_static."""
    with BagReader(bag) as reader:
        topic = next((name for name in TRUTHS if name in reader.topics and reader.topics[name].count), None)
        tree, frame = TransformTree(), next(reader.messages([_image(bag)])).message.header.frame_id
        for item in reader.messages(["/tf_static"]) if "/tf_static" in reader.topics else ():
            for transform in item.message.transforms:
                tree.add(transform, is_static=True)
    if topic is None:
        return None
    poses = read_poses(bag, (topic,))
    if topic == TRUTHS[0]:
        return poses
    T_body_base = T_BODY_OPTICAL @ tree.lookup("base_link", frame).inverse()
    return Trajectory(poses.stamps_ns, poses.T_map_body @ T_body_base)


def _size(path: Path) -> int:
    with open_map(path) as reader:
        return len(reader.graph)
