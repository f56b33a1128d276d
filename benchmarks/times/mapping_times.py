"""What a sphere costs from the six images of an instant to the map: CPU, and the size of a key sphere.

The simulator's rigs: the car is put along a street, each instant is stitched, and placed by the mapper that writes its
key spheres to a map. A key sphere's size is its share of the map.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import repeat_cpu
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.times.kernel_times import yardstick
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.constants import NUM_INSTANTS
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_nav.params import build
from sphere_nav.ros.maps.writer import MapWriter

HELP = "CPU of a sphere from six images to the map, the size of a key sphere"
WIDTH, QUICK_WIDTH = 2048, 1024
INSTANTS, QUICK_INSTANTS, SPACING_M = 9, 5, 1.2
WITHOUT_S, WITH_S, KEY_MB = {"vertical": 0.6, "ring": 0.8}, {"vertical": 0.8, "ring": 1.1}, 8.0  # at 2048 x 1024


def run(options: argparse.Namespace) -> Report:
    """Stitch and map with both rigs."""
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
