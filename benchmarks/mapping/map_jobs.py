"""`sphere_nav map --jobs N` on a drive with six cameras: the same map bit for bit, its wall time and its memory."""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from pathlib import Path

import numpy as np
from tf2_msgs.msg import TFMessage

from benchmarks.commands import COMMAND
from benchmarks.machine import num_cores
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rig import images_along, rig_in_world
from cycab_sim.sensors.cameras import rig_place
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, se3_to_transform
from sphere_nav_tools.cli.processes import python_command

INSTANTS, QUICK_INSTANTS, SPACING_M, STEP_NS = 410, 12, 1.2, 250_000_000
JOBS, SPEED_UP = (1, 2), 1.7


def run(options: argparse.Namespace) -> Report:
    """Draw a drive, map it by one process and by several; `make env` has compiled the kernels."""
    number, width = (QUICK_INSTANTS, 512) if options.size == "quick" else (INSTANTS, 1024)
    folder = options.folder
    _draw(folder, number, width, options.seed)
    found = {jobs: _map(folder, str(jobs), jobs, width) for jobs in JOBS}
    one, other = (np.fromfile(folder / str(jobs) / "map.mcap", np.uint8) for jobs in JOBS)
    rows = [(str(jobs), f"{seconds:.1f}", f"{memory:.0f}") for jobs, (seconds, memory) in found.items()]
    title = f"{number} instants, {SPACING_M * number:.0f} m, spheres {width} px wide, {num_cores()} cores"
    report, told = Report("map_jobs"), Headline("times and memory", f"city of the simulator, {width} px")
    report.tables.append(Table(title, ("processes", "wall s", "largest process MB"), rows))
    both = min(len(one), len(other))
    different = np.count_nonzero(one[:both] != other[:both]) + abs(len(one) - len(other))
    report.bounds += [
        Bound(f"map by {JOBS[1]} processes: bytes that differ", 0.0, float(different), "", False, told),
        Bound("wall time of one process by theirs", SPEED_UP, found[1][0] / found[JOBS[1]][0], "", True),
    ]
    return report


def _draw(folder: Path, number: int, width: int, seed: int) -> None:
    """Write a bag with what six cameras see on the way through a town, and their rig file."""
    simulator, rig = rig_in_world(seed, width, {"world": "city"})
    write_rig(folder / "rig.yaml", rig)
    with BagWriter(folder / "bag") as bag:
        mount = se3_to_transform(rig_place(simulator.params.rig), STEP_NS, "base_link", "rig_link")
        bag.write("/tf_static", TFMessage(transforms=[mount]), STEP_NS)
        for index, images in enumerate(images_along(simulator, number, SPACING_M), start=1):
            for name, image in images.items():
                message = array_to_image(image, STEP_NS * index, f"{name}_optical", "rgb8")
                bag.write(f"cameras/{name}/image_raw", message, STEP_NS * index)


def _map(folder: Path, name: str, jobs: int, width: int) -> tuple[float, float]:
    """Map the drive in a process of its own; return wall time in s and the largest memory of one process in MB."""
    words = ["map", "bag", "-o", name, "--rig", "rig.yaml", "--jobs", jobs, "--set-stitcher", f"stitch.width={width}"]
    begun = time.perf_counter()
    process = subprocess.Popen(python_command(COMMAND, *map(str, words)), cwd=folder, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise ValueError(f"map: expected exit code 0, found {status >> 8}")
    return time.perf_counter() - begun, usage.ru_maxrss / 1024
