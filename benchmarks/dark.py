"""A recorded room by night: a torch alone, and a light that goes out; images placed by colour, and with depth.

A map is made of every third image by day; the next but one of each is a drive, seen by a torch beside the lens, by the
same while part of the texture is inverted, or not at all from the 13th image on. The start is given, 0.1 m and 5 deg
off. And what depth accepts where the vehicle is elsewhere: guesses a room's width about the truth.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.machine import describe
from benchmarks.other_light import Gray, Light
from benchmarks.relight import FRAMES, WRONG, Placed, Room
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import colmap_poses
from dense_localizer.inputs import LocalizerInput
from dense_localizer.judge.acceptance import refuse
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import Choice, References
from dense_localizer.track.range_support import RangeSupport
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import FINE
from sphere_nav.params import build
from sphere_nav.photometric.align.judgement import UNKNOWN
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import camera_from_info, depth_to_meters, stamp_ns
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.range_alignment import DepthImage
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "a recorded room by night: images placed by colour, and with depth; wrong places that depth accepts"
SEED = 11  # of patches
OFF = np.array([0.1, 0.0, 0.0, 0.0, 0.0, np.radians(5.0)])  # of the start, from the truth
LIT = 12  # images until the light goes out
GUESS = np.array([0.5, 0.5, 0.2, 0.1, 0.1, 0.5])  # m, rad: guesses are as far off, evenly


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; the room and its halves are those of relight."""
    parser.add_argument("--guesses", type=int, default=1000, metavar="N", help="poses elsewhere that are tried (1000)")


def run(options: argparse.Namespace) -> Report:
    """Measure every darkness."""
    poses = colmap_poses(options.room)
    if poses is None or not options.room.is_dir():
        return Report("dark", skipped=f"no {options.room} with COLMAP's poses beside it")
    report = Report("dark", notes=[describe(options.threads), f"images: {options.lights}"])
    with tempfile.TemporaryDirectory() as temporary:
        room = Room(options.room, poses, FRAMES[options.lights], options.keep or Path(temporary))
        day, rows = room.base(), []
        torches = {"torch": "lamp", "torch, patches": "season"}
        nights: dict[str, Any] = {name: room.light(kind, 1.0, SEED, Torch) for name, kind in torches.items()}
        nights["out"] = Out()
        for name, light in nights.items():
            drive = name.replace(", ", "_")
            room.drive(drive, light, 2)
            rows.append((name, *(str(one) for one in place(room, drive, name, day, report))))
        report.tables.append(Table("Images placed, wrong ones, median error", ("night", "colour", "with depth"), rows))
        elsewhere(room, 100 if options.quick else options.guesses, report)
    return report


def place(room: Room, drive: str, name: str, day: Placed, report: Report) -> tuple[Placed, Placed]:
    """Return what colour makes of a drive, and with depth; add the bounds."""
    truth = read_poses(room.folder / f"{drive}_2", ("ground_truth/pose",)).T_map_body[0] @ SE3.exp(OFF)
    numbers = *truth.translation, *Rotation.from_matrix(truth.rotation).as_quat()
    start = f"--initial-pose={','.join(f'{number:.6f}' for number in numbers)}"
    colour, depth = (room.localize("map_day", f"{drive}_2", start, *more) for more in ((), ("--set", "use_depth=true")))
    report.bounds += [
        Bound(f"{name}: images placed with depth, at least as by day", day.placed, depth.placed, "", True),
        Bound(f"{name}: wrong, both ways", 0, colour.num_wrong + depth.num_wrong, ""),
    ]
    return colour, depth


class Torch(Light):
    """Night but for a lamp beside the lens."""

    def _light(self, world: Array, facing: Array, points: Array, normals: Array) -> Array:
        distance = np.linalg.norm(points, axis=-1)
        beam = np.exp(-((points[..., 0] / points[..., 2]) ** 2 + (points[..., 1] / points[..., 2]) ** 2) / 0.18)
        shade = np.abs(np.sum(points * normals, axis=-1)) / distance
        return np.asarray(0.02 + 1.6 * beam * shade / np.maximum(distance, 0.7) ** 2)


class Out:
    """Day, until the light goes out."""

    def __init__(self) -> None:
        self.count = 0

    def shine(self, gray: Gray, depth_m: Gray, T_world_camera: Any) -> Gray:
        """Return the image as it is, or black."""
        self.count += 1
        return gray if self.count <= LIT else np.zeros_like(gray)


@dataclass
class Elsewhere:
    """Guesses that depth accepted, and that were wrong."""

    num_tried: int = 0
    num_accepted: int = 0
    num_wrong: int = 0


def elsewhere(room: Room, count: int, report: Report) -> None:
    """Add how often depth accepts a place where it was not, given as near; and where only images predict it."""
    rng, params = np.random.default_rng(SEED), build(LocalizerParams, {})
    images = depth_images(room.folder / "day_2")
    with open_map(room.folder / "map_day") as reader:
        references = References(reader, params)
        support, found = RangeSupport(references, params), Elsewhere()
        for number in range(count):
            T_true, depth = images[number % len(images)]
            T_guess = T_true @ SE3.exp(rng.uniform(-GUESS, GUESS))
            prediction = Prediction.guess(T_guess, is_near=True)
            nothing = PoseCandidate(T_guess, UNKNOWN, prediction, Choice.merge(()), refuse(FINE))
            placed = support.support(LocalizerInput(1, depth=depth), nothing)
            meters, radians = placed.T_map_camera.distance(T_true)
            is_wrong = meters > WRONG[0] or radians > np.radians(WRONG[1])
            found.num_tried += 1
            found.num_accepted += placed.acceptance.is_good
            found.num_wrong += placed.acceptance.is_good and bool(is_wrong)
        references.close()
    limit = 3.0 / max(found.num_accepted, 1)  # 95 % bound of a share of which nothing was seen
    report.notes.append(
        f"guesses up to {GUESS[0]:g} m and {np.degrees(GUESS[-1]):.0f} deg off: {found.num_accepted} of "
        f"{found.num_tried} accepted; without a wrong one fewer than {limit:.1%} are (95 %)"
    )
    report.bounds.append(Bound("guesses elsewhere: accepted and wrong", 0, found.num_wrong, f"of {found.num_tried}"))


def depth_images(bag_path: Path) -> list[tuple[SE3, DepthImage]]:
    """Return the true pose T_map_camera (optical axes) and the depth of each image of a drive."""
    truth = read_poses(bag_path, ("ground_truth/pose",))
    poses = {int(stamp): truth.T_map_body[k] @ T_BODY_OPTICAL for k, stamp in enumerate(truth.stamps_ns)}
    with BagReader(bag_path) as bag:
        camera = camera_from_info(next(bag.messages(["/depth/camera_info"])).message)
        return [
            (poses[stamp_ns(one.message)], DepthImage(depth_to_meters(one.message), camera, SE3.identity()))
            for one in bag.messages(["/depth/image_raw"])
        ]
