"""What a sphere costs from the six images of an instant to the map: CPU, by one process and by several.

The simulator's rigs: the car is put along a street, each instant is stitched, and placed by the mapper that writes its
key spheres to a map. A key sphere's size is its share of the map. And `sphere_nav map --jobs N`: the wall time by that
of one process, and whether it makes the same map.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

from benchmarks.machine import repeat_cpu
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.times.kernel_times import yardstick
from cycab_sim.params import SimParams
from cycab_sim.sensors.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.constants import NUM_INSTANTS
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, se3_to_transform
from sphere_nav.ros.maps.writer import MapWriter

HELP = "CPU of a sphere from six images to the map, the size of a key sphere; several processes"
WIDTH, QUICK_WIDTH = 2048, 512
INSTANTS, QUICK_INSTANTS, SPACING_M, STEP_NS = 9, 5, 1.2, 250_000_000
JOB_INSTANTS, QUICK_JOB_INSTANTS, JOBS, JOB_WIDTH = 410, 6, 2, 1024
WITHOUT_S, WITH_S, KEY_MB = {"vertical": 0.6, "ring": 0.8}, {"vertical": 0.8, "ring": 1.1}, 8.0  # at 2048 x 1024
PATIENCE_S = 7200.0
CODE = "import sys; from sphere_nav_tools.cli.main import main; sys.exit(main())"


def run(options: argparse.Namespace) -> Report:
    """Stitch and map with both rigs, then by several processes."""
    report, is_quick, before = (
        Report("mapping_times", notes=[__doc__ or ""]),
        options.size == "quick",
        cv2.getNumThreads(),
    )
    width = options.width or (QUICK_WIDTH if is_quick else WIDTH)
    cv2.setNumThreads(1)
    try:
        for kind in ("vertical",) if is_quick else ("vertical", "ring"):
            measure(kind, width, QUICK_INSTANTS if is_quick else INSTANTS, options.seed, report)
    finally:
        cv2.setNumThreads(before)
    map_by_several(QUICK_JOB_INSTANTS if is_quick else JOB_INSTANTS, min(width, JOB_WIDTH), options.seed, report)
    return report


def measure(kind: str, width: int, number: int, seed: int, report: Report) -> None:
    """Add one rig's table and bounds; bounds are of 2048 columns, the time grows with the pixels."""
    size, share = width * 17 // 32, (width / WIDTH) ** 2
    simulator = Simulator(build(SimParams, {"seed": seed, "rig.kind": kind, "rig.size": f"{size},{size}"}))
    assert simulator.rig is not None
    stitcher = Stitcher(simulator.rig, build(StitchParams, {"width": width}))
    instants = list(instants_of(simulator, number))
    for images in (instants * NUM_INSTANTS)[:NUM_INSTANTS]:  # makes the tables of the rig, learns the lenses' falloff
        stitcher.stitch(images)
    seconds: dict[str, list[float]] = {"stitch": [], "register": [], "register, new key sphere": []}
    with tempfile.TemporaryDirectory() as folder:
        writer = MapWriter(Path(folder) / "map")
        mapper = Mapper(MapperParams(), store=writer)
        for index, images in enumerate(instants):
            cpu = time.process_time()
            sphere = stitcher.stitch(images, index + 1).sphere
            stitched = time.process_time()
            update = mapper.add(sphere)
            seconds["stitch"].append(stitched - cpu)
            if index:  # the first one is not registered
                seconds["register, new key sphere" if update.is_key else "register"].append(
                    time.process_time() - stitched
                )
        path = writer.finish(mapper.graph, appearance=mapper.appearance)
        megabytes = 1e-6 * sum(file.stat().st_size for file in path.iterdir()) / len(mapper.graph)
    unit_s = 1e-3 * float(np.median(repeat_cpu(yardstick(), 20)))
    rows = [
        (name, f"{np.median(some):.3f}", f"{np.median(some) / unit_s:.0f}") for name, some in seconds.items() if some
    ]
    report.tables.append(Table(f"{kind}, {width} columns, {number} instants", ("what", "CPU s", "yardsticks"), rows))
    stitched, without, with_key = (float(np.median(some or [np.nan])) for some in seconds.values())
    what, of = (
        f"{kind}: CPU of a sphere {width} wide from six images to the map",
        Headline("times and memory", "a town"),
    )
    report.bounds += [
        Bound(f"{what}, no key sphere", share * WITHOUT_S[kind], stitched + without, "s"),
        Bound(f"{what}, a key sphere", share * WITH_S[kind], stitched + with_key, "s", headline=of),
        Bound(f"{kind}: a key sphere {width} wide in the map", share * KEY_MB, megabytes, "MB"),
    ]


def instants_of(simulator: Simulator, number: int) -> Iterator[Mapping[str, NDArray[np.uint8]]]:
    """Yield what the rig sees from place to place along the path."""
    for index in range(number):
        simulator.teleport(*simulator.path.at(np.array(5.0 + SPACING_M * index)).tolist()[:3])
        yield {name: frame.image for name, frame in simulator.capture_rig().items()}


# --- several processes
def map_by_several(number: int, width: int, seed: int, report: Report) -> None:
    """Draw a drive, map it by one process and by several."""
    seconds, maps = list[float](), list[bytes]()
    with tempfile.TemporaryDirectory() as folder:
        draw(Path(folder), number, width, seed)
        for jobs in (1, JOBS):
            begun = time.perf_counter()
            maps.append(map_drive(Path(folder), str(jobs), jobs, width))
            seconds.append(time.perf_counter() - begun)
    speed_up, of = seconds[0] / seconds[1], Headline("times and memory", f"{number} instants of a city")
    report.notes.append(f"{number} instants: {seconds[0]:.1f} s by one process, {seconds[1]:.1f} s by {JOBS}")
    report.bounds += [
        Bound(f"map by {JOBS} processes: wall time of one by theirs", 1.7, speed_up, "", True, of),
        Bound(f"map by {JOBS} processes: is another one than by one", 0, maps[0] != maps[1], ""),
    ]


def draw(folder: Path, number: int, width: int, seed: int) -> None:
    """Write a bag with what six cameras see on the way through a city, and their rig file."""
    size = width * 17 // 32
    values = {"world": "city", "seed": seed, "rig.kind": "vertical", "rig.size": f"{size},{size}"}
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    write_rig(folder / "rig.yaml", simulator.rig)
    with BagWriter(folder / "bag") as bag:
        bag.add_topic("/tf_static", TFMessage, qos.LATCHED)
        mount = se3_to_transform(rig_place(simulator.params.rig), STEP_NS, "base_link", "rig_link")
        bag.write("/tf_static", TFMessage(transforms=[mount]), STEP_NS)
        for index, images in enumerate(instants_of(simulator, number)):
            stamp_ns = STEP_NS * (index + 1)
            for name, image in images.items():
                topic = f"cameras/{name}/image_raw"
                bag.add_topic(topic, Image, qos.LARGE)
                bag.write(topic, array_to_image(image, stamp_ns, f"{name}_optical", "rgb8"), stamp_ns)


def map_drive(folder: Path, name: str, jobs: int, width: int) -> bytes:
    """Map the drive in a process of its own; return the file."""
    words = ["map", "bag", "-o", name, "--rig", "rig.yaml", "--jobs", jobs, "--set-stitcher", f"stitch.width={width}"]
    command = [sys.executable, "-P", "-c", CODE, *map(str, words)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    if done.returncode:
        raise ValueError(f"map: expected exit code 0, found {done.returncode}: {done.stderr[-500:]}")
    return (folder / name / "map.mcap").read_bytes()
