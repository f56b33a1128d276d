"""`sphere_nav map --jobs N` on a drive with six cameras: the same map bit for bit, its wall time and its memory."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

from benchmarks.machine import num_cores
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.sensors.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, se3_to_transform

HELP = "map of six cameras by several processes: the same map bit for bit, wall time, memory"
INSTANTS, QUICK_INSTANTS, SPACING_M, STEP_NS = 410, 12, 1.2, 250_000_000
JOBS, SPEED_UP = (1, 2), 1.7
CODE = "import sys; from sphere_nav_tools.cli.main import main; sys.exit(main())"


def run(options: argparse.Namespace) -> Report:
    """Draw a drive, map it by one process and by several; kernels are compiled before."""
    number, width = (QUICK_INSTANTS, 512) if options.size == "quick" else (INSTANTS, 1024)
    width = options.width or width
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _draw(folder, number, width, options.seed)
        _map(folder, "first", 1, width)
        found = {jobs: _map(folder, str(jobs), jobs, width) for jobs in JOBS}
        maps = [(folder / str(jobs) / "map.mcap").read_bytes() for jobs in JOBS]
    rows = [(str(jobs), f"{seconds:.1f}", f"{memory:.0f}") for jobs, (seconds, memory) in found.items()]
    title = f"{number} instants, {SPACING_M * number:.0f} m, spheres {width} px wide, {num_cores()} cores"
    report, told = Report("map_jobs"), Headline("times and memory", f"city of the simulator, {width} px")
    report.tables.append(Table(title, ("processes", "wall s", "largest process MB"), rows))
    report.bounds += [
        Bound(f"map by {JOBS[1]} processes: bytes that differ", 0.0, _num_different(*maps), "", False, told),
        Bound("wall time of one process by theirs", SPEED_UP, found[1][0] / found[JOBS[1]][0], "", True),
    ]
    return report


def _draw(folder: Path, number: int, width: int, seed: int) -> None:
    """Write a bag with what six cameras see on the way through a town, and their rig file."""
    size = width * 17 // 32
    values = {"world": "city", "seed": seed, "rig.kind": "vertical", "rig.size": f"{size},{size}"}
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    write_rig(folder / "rig.yaml", simulator.rig)
    with BagWriter(folder / "bag") as bag:
        bag.add_topic("/tf_static", TFMessage, qos.LATCHED)
        mount = se3_to_transform(rig_place(simulator.params.rig), STEP_NS, "base_link", "rig_link")
        bag.write("/tf_static", TFMessage(transforms=[mount]), STEP_NS)
        for index in range(number):
            stamp_ns = STEP_NS * (index + 1)
            x, y, yaw, _ = simulator.path.at(np.array(5.0 + SPACING_M * index))
            simulator.teleport(float(x), float(y), float(yaw))
            for name, frame in simulator.capture_rig().items():
                topic = f"cameras/{name}/image_raw"
                bag.add_topic(topic, Image, qos.LARGE)
                bag.write(topic, array_to_image(frame.image, stamp_ns, f"{name}_optical", "rgb8"), stamp_ns)


def _map(folder: Path, name: str, jobs: int, width: int) -> tuple[float, float]:
    """Map the drive in a process of its own; return wall time in s and the largest memory of one process in MB."""
    words = ["map", "bag", "-o", name, "--rig", "rig.yaml", "--jobs", jobs, "--set-stitcher", f"stitch.width={width}"]
    begun = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        command = [sys.executable, "-P", "-c", CODE, *map(str, words)]
        process = subprocess.Popen(command, cwd=folder, stdout=said, stderr=said)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - begun
        said.seek(0)
        if status:
            raise ValueError(f"map: expected exit code 0, found {status >> 8}: {said.read().decode()[-500:]}")
    return seconds, usage.ru_maxrss / 1024


def _num_different(one: bytes, other: bytes) -> float:
    """Return how many bytes differ, those that one of the two lacks among them."""
    number = min(len(one), len(other))
    a, b = (np.frombuffer(file, np.uint8, number) for file in (one, other))
    return float(np.count_nonzero(a != b) + abs(len(one) - len(other)))
