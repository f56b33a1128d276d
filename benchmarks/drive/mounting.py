"""The same drive with every mounting of the demo's camera.

In the town the drive is taught by an RGB-D camera with noise and mapped by the command: the taught path must not depend
on how the camera sits.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tf2_msgs.msg import TFMessage

from benchmarks.commands import call
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav_tools.cli.demo.demo import MOUNTINGS

HELP = "the same drive with four mountings: taught paths"
SIMULATION = {"path": "two_turns", "camera.period": 0.2, "sphere.width": 0, "traffic.density": "none"}
WIDTH, ASPECT = 320, 0.75  # px of the camera; its height by its width
WAY_M, QUICK_WAY_M, SPACING_M = 8.0, 3.0, 0.25  # that is taught; between two images
IMAGE_NOISE, DEPTH_NOISE = 1.5, 0.002  # grey levels; share of the depth
STEP_NS = 10_000_000
SAME_MM, SAME_DEG = 5.0, 0.1  # between the taught paths of two mountings
FRAME = "camera_optical"


def run(options: argparse.Namespace) -> Report:
    """Teach, compare."""
    report, is_quick = Report("mounting", notes=[__doc__ or ""]), options.size == "quick"
    town = Town(options.seed, options.width or WIDTH, QUICK_WAY_M if is_quick else WAY_M)
    with tempfile.TemporaryDirectory() as folder:
        town.measure(Path(folder), list(MOUNTINGS)[:: 3 if is_quick else 1], report)
    return report


@dataclass(frozen=True)
class Town:
    """Where the drive is taught."""

    seed: int
    width: int
    way_m: float

    def measure(self, folder: Path, names: list[str], report: Report) -> None:
        """Teach and map with every mounting; compare the taught paths with the first one, and with the truth."""
        rows, offs, first = list[tuple[str, ...]](), list[tuple[float, float]](), None
        for name in names:
            taught, truth = self.teach_and_map(folder / name, name)
            first = taught if first is None else first
            offs.append(compare(taught, first))
            rows.append((name, *words(offs[-1]), words(compare(taught, truth))[0]))
        columns = ("camera", "taught path off the first", "turned", "off the truth")
        report.tables.append(Table(f"Taught in the town, {self.way_m:g} m", columns, rows))
        moved, turned = (max(one) for one in zip(*offs, strict=True))
        of = Headline("drives and missions", f"{len(names)} mountings, {self.way_m:g} m of a town")
        report.bounds += [
            Bound("mountings: taught paths apart, largest", SAME_MM, moved, "mm", headline=of),
            Bound("mountings: taught paths turned, largest", SAME_DEG, turned, "deg"),
        ]

    def simulate(self, mounting: str) -> Simulator:
        """Return the town with a car whose camera sits so."""
        size = {"seed": self.seed, "camera.size": f"{self.width},{round(ASPECT * self.width)}"}
        return Simulator(build(SimParams, SIMULATION | size | MOUNTINGS[mounting] | {"mode": "teach"}))

    def teach_and_map(self, folder: Path, mounting: str) -> tuple[Trajectory, Trajectory]:
        """Return the taught path, and the truth; the map is folder/map."""
        folder.mkdir()
        truth = self.teach(folder / "bag", self.simulate(mounting))
        call("map", folder / "bag", "-o", folder / "map", "--taught", folder / "path.tum")
        return read_tum(folder / "path.tum"), truth

    def teach(self, path: Path, simulator: Simulator) -> Trajectory:
        """Write the bag of a teaching drive with an RGB-D camera; return the true poses at the images."""
        mount, next_m = simulator.mounts["camera"], 0.0
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
                simulator.step(simulator.teach_command(), STEP_NS)
        T_world_base = SE3(np.array(poses))
        return Trajectory(np.array(stamps), T_world_base[0].inverse() @ T_world_base)


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
