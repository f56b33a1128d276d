"""The same drive with every mounting of the demo's camera, and starts from nowhere with a camera that is turned.

In the town the drive is taught by an RGB-D camera with noise, mapped by the command, and driven again in that map: the
taught path must not depend on how the camera sits. Redkitchen is mapped upright; images of it, turned by quarters, are
placed from nowhere.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

from benchmarks.commands import TRUTH, call
from benchmarks.drive.long_drive import STEP_NS, Taught, drive
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rgbd_data import Recording
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
from sphere_nav.ros.conversions import array_to_image, camera_from_info, camera_to_info, se3_to_transform, stamp_ns
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.demo.demo import MOUNTINGS
from sphere_nav_tools.cli.demo.report import distances_from_path
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "the same drive with four mountings: taught paths, drives in the simulator, starts from nowhere"
SIMULATION = {"path": "two_turns", "camera.period": 0.2, "sphere.width": 0, "traffic.density": "none"}
WIDTH, ASPECT = 320, 0.75  # px of the camera; its height by its width
WAY_M, QUICK_WAY_M, SPACING_M = 8.0, 3.0, 0.25  # that is taught; between two images
IMAGE_NOISE, DEPTH_NOISE = 1.5, 0.002  # grey levels; share of the depth
SAME_MM, SAME_DEG = 5.0, 0.1  # between the taught paths of two mountings
MAX_LATERAL_CM = 10.0
FRAME = "camera_optical"
FRAMES, MAPPED = "0:118", "0:118:3"
FOUND_M, FOUND_DEG = 0.1, 5.0  # of a start
QUICK_STEP, NUM_QUARTERS = 20, 4  # of the frames that are localised


@dataclass(frozen=True)
class Teaching:
    """Where the car truly went (N, 2) m, and the true poses of `base_link` at the images, the first as the origin."""

    way: NDArray[np.float64]
    poses: Trajectory


def run(options: argparse.Namespace) -> Report:
    """Teach, compare, drive, start."""
    report, is_quick = Report("mounting", notes=[__doc__ or ""]), options.size == "quick"
    town = Town(options.seed, options.width or WIDTH, QUICK_WAY_M if is_quick else WAY_M)
    with tempfile.TemporaryDirectory() as folder:
        town.measure(Path(folder), list(MOUNTINGS)[:: 3 if is_quick else 1], report)
    recording = Recording.open(options.data)
    if recording is not None:
        with tempfile.TemporaryDirectory() as folder:
            start_in_kitchen(report, recording, Path(folder), QUICK_STEP if is_quick else 1)
    return report


@dataclass(frozen=True)
class Town:
    """Where the drive is taught."""

    seed: int
    width: int
    way_m: float

    def measure(self, folder: Path, names: list[str], report: Report) -> None:
        """Teach, map and drive with every mounting; compare the taught paths with the first one, and with the truth."""
        rows, offs, laterals, first = list[tuple[str, ...]](), list[tuple[float, float]](), list[float](), None
        for name in names:
            taught, teaching = self.teach_and_map(folder / name, name)
            first = taught if first is None else first
            off, off_truth = compare(taught, first), compare(taught, teaching.poses)
            lateral, share, end = self.drive_again(folder / name, name, taught, teaching.way)
            offs.append(off)
            laterals.append(lateral if share > 0.95 else np.inf)
            rows.append((name, *words(off), words(off_truth)[0], f"{lateral:.1f} cm", f"{share:.1%}", end))
        columns = ("camera", "taught path off the first", "turned", "off the truth", "driven, lateral", "share", "end")
        report.tables.append(Table(f"Taught and driven in the town, {self.way_m:g} m", columns, rows))
        moved, turned = (max(one) for one in zip(*offs, strict=True))
        of = Headline("drives and missions", f"{len(names)} mountings, {self.way_m:g} m of a town")
        report.bounds += [
            Bound("mountings: taught paths apart, largest", SAME_MM, moved, "mm", headline=of),
            Bound("mountings: taught paths turned, largest", SAME_DEG, turned, "deg"),
            Bound("mountings: lateral error of a drive, largest", MAX_LATERAL_CM, max(laterals), "cm"),
        ]

    def simulate(self, mounting: str, mode: str) -> Simulator:
        """Return the town with a car whose camera sits so."""
        size = {"seed": self.seed, "camera.size": f"{self.width},{round(ASPECT * self.width)}"}
        return Simulator(build(SimParams, SIMULATION | size | MOUNTINGS[mounting] | {"mode": mode}))

    def teach_and_map(self, folder: Path, mounting: str) -> tuple[Trajectory, Teaching]:
        """Return the taught path, and the truth; the map is folder/map."""
        folder.mkdir()
        teaching = self.teach(folder / "bag", self.simulate(mounting, "teach"))
        call("map", folder / "bag", "-o", folder / "map", "--taught", folder / "path.tum")
        return read_tum(folder / "path.tum"), teaching

    def drive_again(
        self, folder: Path, name: str, taught: Trajectory, truth: NDArray[np.float64]
    ) -> tuple[float, float, str]:
        """Drive a taught path in its map; return the largest lateral error in cm, the share driven, how it ended."""
        with open_map(folder / "map") as sphere_map:
            path_taught = Taught(SphereGraph(), taught.stamps_ns, taught.T_map_body, truth, 0)
            driven = drive(self.simulate(name, "drive"), path_taught, sphere_map)
        along, lateral = distances_from_path(driven.truth, truth)
        length = float(np.linalg.norm(np.diff(truth, axis=0), axis=1).sum())
        return 100 * float(np.abs(lateral).max()), float(along.max()) / length, driven.end

    def teach(self, path: Path, simulator: Simulator) -> Teaching:
        """Write the bag of a teaching drive with an RGB-D camera; return where the car truly went."""
        mount, way, next_m = simulator.mounts["camera"], [], 0.0
        stamps, poses = list[int](), list[NDArray[np.float64]]()
        assert isinstance(mount.camera, Pinhole)
        z_of_ray, rng = pixel_rays(mount.camera)[..., 2], np.random.default_rng(self.seed)
        with BagWriter(path) as bag:
            bag.add_topic("/tf_static", TFMessage, qos.LATCHED)
            place = se3_to_transform(mount.T_base_camera, simulator.time_ns, "base_link", FRAME)
            bag.write("/tf_static", TFMessage(transforms=[place]), simulator.time_ns)
            while simulator.driver.distance < self.way_m:
                if simulator.driver.distance >= next_m:
                    next_m, stamp = next_m + SPACING_M, simulator.time_ns
                    image, range_m = simulator.render(mount.camera, simulator.T_world_base @ mount.T_base_camera, True)
                    image = np.clip(np.rint(image + IMAGE_NOISE * rng.standard_normal(image.shape)), 1, 255)
                    depth_m = range_m * z_of_ray * (1.0 + DEPTH_NOISE * rng.standard_normal(image.shape))
                    depth = array_to_image(depth_m.astype(np.float32), stamp, FRAME, "32FC1")
                    write(bag, "/camera_info", camera_to_info(mount.camera, stamp, FRAME), stamp)
                    write(bag, "/depth/image_raw", depth, stamp)
                    write(bag, "/image_raw", array_to_image(image.astype(np.uint8), stamp, FRAME, "mono8"), stamp)
                    stamps.append(stamp)
                    poses.append(simulator.T_world_base.matrix)
                way.append((simulator.vehicle.state.x, simulator.vehicle.state.y))
                simulator.step(simulator.teach_command(), STEP_NS)
        T_world_base, xy = SE3(np.array(poses)), np.array(way)
        is_new = np.append(True, np.any(np.diff(xy, axis=0) != 0.0, axis=1))
        return Teaching(xy[is_new], Trajectory(np.array(stamps), T_world_base[0].inverse() @ T_world_base))


def words(off: tuple[float, float]) -> tuple[str, str]:
    """Return a distance in mm and a turn in deg as they are printed."""
    return f"{off[0]:.1f} mm", f"{off[1]:.2f} deg"


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
def start_in_kitchen(report: Report, recording: Recording, folder: Path, step: int) -> None:
    """Map the kitchen; localise images between the mapped ones, turned each way, from nowhere."""
    for name, frames in (("all", FRAMES), ("mapped", MAPPED)):
        words_of = ("--frames", frames, "--poses", recording.poses, "--truth-camera", "colour")
        call("import", "seven_scenes", recording.folder, "-o", folder / name, *words_of)
    call("map", folder / "mapped", "-o", folder / "map", "--anchor", "truth")
    truth, mapped = read_poses(folder / "all", TRUTH), set(read_poses(folder / "mapped", TRUTH).stamps_ns.tolist())
    with open_map(folder / "map", is_gray=True) as sphere_map, BagReader(folder / "all") as drives:
        localizer = Localizer(LocalizerParams(), sphere_map)
        camera = camera_from_info(next(iter(drives.messages(["/camera_info"]))).message)
        assert isinstance(camera, Pinhole)
        images = [item.message for item in drives.messages(["/image_raw"])]
        others = [one for one in images if stamp_ns(one) not in mapped][::step]
        found = [start(localizer, one, camera, truth, quarters) for one in others for quarters in range(NUM_QUARTERS)]
        localizer.references.close()
    what = f"redkitchen, starts of {len(others)} images, each turned to all sides"
    report.bounds += [
        Bound(f"{what}, found", 95.0, 100.0 * found.count(True) / len(found), "%", is_minimum=True),
        Bound(f"{what}, elsewhere", 0, found.count(False), "images"),
    ]


def start(localizer: Localizer, message: Image, camera: Pinhole, truth: Trajectory, quarters: int) -> bool | None:
    """Localise one image from nowhere; return whether that is right, None where it is not found."""
    localizer.reset()
    image = np.ascontiguousarray(np.rot90(read_gray(message, (camera.width, camera.height)), quarters))
    candidate = localizer.update(image, turn_camera(camera, quarters), stamp_ns(message)).candidate
    if candidate is None or not candidate.acceptance.is_good:
        return None
    at, _ = truth.at([stamp_ns(message)])
    T_camera_turned = SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.5 * np.pi * quarters])  # its right is the old down
    T_map_camera = at.T_map_body[0] @ T_BODY_OPTICAL @ T_camera_turned
    distance, angle = candidate.T_map_camera.distance(T_map_camera)
    return bool(distance < FOUND_M and angle < np.radians(FOUND_DEG))


def turn_camera(camera: Pinhole, quarters: int) -> Pinhole:
    """Return the lens of images turned by `np.rot90`; it has no distortion."""
    fx, fy, cx, cy, width, height = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    for _ in range(quarters):
        fx, fy, cx, cy, width, height = fy, fx, cy, width - 1 - cx, height, width
    return Pinhole(width, height, fx, fy, cx, cy)
