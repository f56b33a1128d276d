"""The same drive with every mounting of the camera.

In the town the drive is taught by an RGB-D camera with noise and mapped by the command: the taught path must not depend
on how the camera sits.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from tf2_msgs.msg import TFMessage

from benchmarks.commands import call
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform

SIMULATION = {"path": "two_turns", "camera.period": 0.2, "camera.size": "320,240", "sphere.width": 0, "mode": "teach"}
MOUNTINGS = {"upright": "0,4", "pitched": "0,30", "rolled": "90,4", "inverted": "180,4"}  # roll, pitch in degrees
SIZES = {"quick": (3.0, 3), "full": (8.0, 1)}  # m of the way that is taught; each how manieth mounting
SPACING_M = 0.25  # between two images
IMAGE_NOISE, DEPTH_NOISE = 1.5, 0.002  # grey levels; share of the depth
STEP_NS = 10_000_000
FRAME = "camera_optical"


def run(options: argparse.Namespace) -> Report:
    """Teach and map with each mounting; compare the taught paths with the first one."""
    report, (way_m, every) = Report("mounting", notes=[__doc__ or ""]), SIZES[options.size]
    names, paths = list(MOUNTINGS)[::every], list[Trajectory]()
    for mounting in names:
        bag, path = options.folder / mounting, options.folder / f"{mounting}.tum"
        teach(bag, mounting, options.seed, way_m)
        call("map", bag, "-o", options.folder / f"{mounting}_map", "--taught", path)
        paths.append(read_tum(path))
    moved, turned = zip(*(compare(path, paths[0]) for path in paths), strict=True)
    rows = [(name, f"{mm:.1f} mm", f"{deg:.2f} deg") for name, mm, deg in zip(names, moved, turned, strict=True)]
    columns = ("camera", "taught path off the first", "turned")
    report.tables.append(Table(f"Taught in the town, {way_m:g} m", columns, rows))
    of = Headline("drives and missions", f"{len(names)} mountings, {way_m:g} m of a town")
    report.bounds += [
        Bound("mountings: taught paths apart, largest", 5.0, max(moved), "mm", headline=of),
        Bound("mountings: taught paths turned, largest", 0.1, max(turned), "deg"),
    ]
    return report


def teach(path: Path, mounting: str, seed: int, way_m: float) -> None:
    """Write the bag of a teaching drive with an RGB-D camera."""
    simulator = Simulator(
        build(SimParams, SIMULATION | {"seed": seed, "camera.mounting_deg": f"1,0,1.6,{MOUNTINGS[mounting]},0"})
    )
    mount, next_m, rng = simulator.mounts["camera"], 0.0, np.random.default_rng(seed)
    with BagWriter(path) as bag:
        place = se3_to_transform(mount.T_base_camera, simulator.time_ns, "base_link", FRAME)
        bag.write("/tf_static", TFMessage(transforms=[place]), simulator.time_ns)
        while simulator.driver.distance < way_m:
            if simulator.driver.distance >= next_m:
                next_m, stamp = next_m + SPACING_M, simulator.time_ns
                gray, range_m = simulator.render(mount.camera, simulator.T_world_base @ mount.T_base_camera, True)
                image = np.clip(np.rint(gray + IMAGE_NOISE * rng.standard_normal(gray.shape)), 1, 255)
                rough = 1.0 + DEPTH_NOISE * rng.standard_normal(gray.shape)
                depth_m = (range_m * pixel_rays(mount.camera)[..., 2] * rough).astype(np.float32)
                bag.write("/camera_info", camera_to_info(mount.camera, stamp, FRAME), stamp)
                bag.write("/depth/image_raw", array_to_image(depth_m, stamp, FRAME, "32FC1"), stamp)
                bag.write("/image_raw", array_to_image(image.astype(np.uint8), stamp, FRAME, "mono8"), stamp)
            simulator.step(simulator.teach_command(), STEP_NS)


def compare(one: Trajectory, other: Trajectory) -> tuple[float, float]:
    """Return the largest distance in mm and turn in deg of poses of the same stamps; NaN where some are missing."""
    if not np.array_equal(one.stamps_ns, other.stamps_ns):
        return np.nan, np.nan
    distances, angles = one.T_map_body.distance(other.T_map_body)
    return 1e3 * float(np.max(distances)), float(np.degrees(np.max(angles)))
