"""`sphere_nav map --jobs N` on a drive with six cameras: its wall time by that of one process, and the same map."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

from benchmarks.machine import describe, num_cores
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.sensors.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, se3_to_transform

HELP = "map of six cameras by several processes: wall time by that of one, and the same map bit for bit"
WIDTH, INSTANTS, QUICK_INSTANTS, SPACING_M, STEP_NS = 1024, 410, 12, 1.2, 250_000_000
PATIENCE_S = 7200.0
CODE = "import sys; from sphere_nav_tools.cli.main import main; sys.exit(main())"


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--jobs-tried", type=int, nargs="+", default=[2], help="numbers of processes (2)")
    parser.add_argument("--jobs-instants", type=int, default=INSTANTS, help="instants of the drive (%(default)s)")
    parser.add_argument("--jobs-width", type=int, default=WIDTH, help="columns of the spheres (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Draw a drive, map it by one process and by several; kernels are compiled before."""
    report = Report("map_jobs", notes=[describe(options.threads), __doc__ or ""])
    number = QUICK_INSTANTS if options.quick else options.jobs_instants
    with tempfile.TemporaryDirectory() as folder:
        _draw(Path(folder), number, options.jobs_width)
        seconds, maps = {}, {}
        for jobs in (1, *options.jobs_tried):
            begun, name = time.perf_counter(), str(jobs)
            maps[name] = _map(Path(folder), name, jobs, options.jobs_width)
            seconds[name] = time.perf_counter() - begun
    rows = [(jobs, f"{seconds[jobs]:.1f}", f"{seconds['1'] / seconds[jobs]:.2f}") for jobs in seconds]
    title = f"{number} instants, {SPACING_M * number:.0f} m, spheres {options.jobs_width} px wide, {num_cores()} cores"
    report.tables.append(Table(title, ("processes", "wall s", "speed-up"), rows))
    for jobs in map(str, options.jobs_tried):
        same = "map by {} processes: bytes of map.mcap that differ from those by one"
        report.bounds += [
            Bound(f"map by {jobs} processes: wall time of one by theirs", 1.7, seconds["1"] / seconds[jobs], "", True),
            Bound(same.format(jobs), 0.0, _num_different(maps["1"], maps[jobs]), ""),
        ]
    return report


def _draw(folder: Path, number: int, width: int) -> None:
    """Write a bag with what six cameras see on the way through a town, and their rig file."""
    size = width * 17 // 32
    simulator = Simulator(build(SimParams, {"world": "city", "rig.kind": "vertical", "rig.size": f"{size},{size}"}))
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


def _map(folder: Path, name: str, jobs: int, width: int) -> bytes:
    """Map the drive in a process of its own; return the file."""
    words = ["map", "bag", "-o", name, "--rig", "rig.yaml", "--jobs", jobs, "--set-stitcher", f"stitch.width={width}"]
    command = [sys.executable, "-P", "-c", CODE, *map(str, words)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    if done.returncode:
        raise ValueError(f"map: expected exit code 0, found {done.returncode}: {done.stderr[-500:]}")
    return (folder / name / "map.mcap").read_bytes()


def _num_different(one: bytes, other: bytes) -> float:
    """Return how many bytes differ, those that one of the two lacks among them."""
    number = min(len(one), len(other))
    a, b = (np.frombuffer(file, np.uint8, number) for file in (one, other))
    return float(np.count_nonzero(a != b) + abs(len(one) - len(other)))
