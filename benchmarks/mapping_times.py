"""What a sphere costs from the six images of an instant to the map, in CPU time of one thread, stage by stage.

The simulator's rigs at 2048 x 1024: the car is put along a street, each instant is stitched, and placed by the mapper
that writes its key spheres to a map. A stage counts what it calls. A key sphere's size is its share of the whole map.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.constants import NUM_INSTANTS
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range import fusion, vertical
from sphere_mapping.acquisition.range.sweep import SphereSweep
from sphere_mapping.acquisition.stitching import stitcher as stitching
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_nav.params import build
from sphere_nav.ros.maps.writer import MapWriter

HELP = "CPU time of a sphere from six images to the map by stage, and the size of a key sphere"
WIDTH = 2048
INSTANTS, QUICK_INSTANTS, SPACING = 9, 5, 1.2  # m
WITHOUT_S, WITH_S, KEY_MB = {"vertical": 0.6, "ring": 0.8}, {"vertical": 0.8, "ring": 1.1}, 8.0
STAGES: dict[str, tuple[tuple[Any, str], ...]] = {  # of stitching, by what they are in the paper: where, and names
    "joining images": ((stitching, "blend"), (vertical, "blend")),
    "matching": ((vertical, "match_columns"), (SphereSweep, "find")),
    "range and common centre": (
        (vertical, "range_from_disparity"),
        (vertical, "to_common_center"),
        (fusion, "fuse_sources"),
    ),
}

Images = Mapping[str, NDArray[np.uint8]]


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Nothing to choose."""


def run(options: argparse.Namespace) -> Report:
    """Stitch and map with both rigs."""
    report = Report("mapping_times", notes=[describe(options.threads), __doc__ or ""])
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for kind in ("vertical", "ring"):
            _measure(kind, QUICK_INSTANTS if options.quick else INSTANTS, report)
    finally:
        cv2.setNumThreads(before)
    return report


def _measure(kind: str, number: int, report: Report) -> None:
    """Add one rig's table and bounds."""
    simulator = Simulator(build(SimParams, {"rig.kind": kind, "rig.size": f"{WIDTH * 17 // 32},{WIDTH * 17 // 32}"}))
    assert simulator.rig is not None
    stitcher = Stitcher(simulator.rig, build(StitchParams, {"width": WIDTH}))
    instants = list(_instants(simulator, number))
    for images in (instants * NUM_INSTANTS)[:NUM_INSTANTS]:  # makes the tables of the rig, learns the lenses' falloff
        stitcher.stitch(images)
    seconds: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder, _timed(seconds):
        writer = MapWriter(Path(folder) / "map")
        mapper = Mapper(MapperParams(), store=writer)
        for index, images in enumerate(instants):
            cpu = time.process_time()
            sphere = stitcher.stitch(images, index + 1).sphere
            stitched = time.process_time()
            update = mapper.add(sphere)
            seconds.setdefault("stitch", []).append(stitched - cpu)
            if index:  # the first one is not registered
                name = "register, new key sphere" if update.is_key else "register"
                seconds.setdefault(name, []).append(time.process_time() - stitched)
        path = writer.finish(mapper.graph, appearance=mapper.appearance)
        size = sum(file.stat().st_size for file in path.iterdir()) / len(mapper.graph)
    report.tables.append(_table(kind, seconds, number))
    report.bounds += _bounds(kind, seconds, size * 1e-6)


def _instants(simulator: Simulator, number: int) -> Iterator[Images]:
    """Yield what the rig sees from place to place along the path."""
    for index in range(number):
        x, y, yaw, _ = simulator.path.at(np.array(5.0 + SPACING * index))
        simulator.teleport(float(x), float(y), float(yaw))
        yield {name: frame.image for name, frame in simulator.capture_rig().items()}


@contextmanager
def _timed(seconds: dict[str, list[float]]) -> Iterator[None]:
    """Measure the stages of the stitcher, by standing before what its modules call."""
    kept = {(module, name): getattr(module, name) for places in STAGES.values() for module, name in places}
    for stage, places in STAGES.items():
        for module, name in places:
            setattr(module, name, _timer(kept[module, name], seconds.setdefault(stage, [])))
    try:
        yield
    finally:
        for (module, name), function in kept.items():
            setattr(module, name, function)


def _timer(function: Callable[..., Any], found: list[float]) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        begun = time.process_time()  # of all threads: pools of one work while this one waits
        try:
            return function(*args, **kwargs)
        finally:
            found.append(time.process_time() - begun)

    return call


def _table(kind: str, seconds: Mapping[str, list[float]], number: int) -> Table:
    """Return the CPU time of a sphere by stage: of stitching, then of the whole."""
    rows = [(stage, f"{sum(seconds[stage]) / number:.3f}") for stage in STAGES if seconds[stage]]
    rest = sum(seconds["stitch"]) - sum(sum(seconds[stage]) for stage in STAGES)
    rows += [("other stitching", f"{rest / number:.3f}"), ("stitch, all", f"{np.mean(seconds['stitch']):.3f}")]
    names = ("register", "register, new key sphere")
    rows += [(name, f"{np.mean(seconds[name]):.3f}") for name in names if seconds.get(name)]
    return Table(f"{kind}, {WIDTH} x {WIDTH // 2}, {number} instants", ("stage", "CPU s a sphere"), rows)


def _bounds(kind: str, seconds: Mapping[str, list[float]], megabytes: float) -> list[Bound]:
    """Return medians of the whole way with and without a new key sphere; NaN, not met, where there was none."""
    stitched = float(np.median(seconds["stitch"]))
    found = [
        stitched + float(np.median(seconds.get(name) or [np.nan])) for name in ("register", "register, new key sphere")
    ]
    what = f"{kind}: CPU of a {WIDTH} x {WIDTH // 2} sphere from six images to the map"
    return [
        Bound(f"{what}, no key sphere", WITHOUT_S[kind], found[0], "s"),
        Bound(f"{what}, a key sphere", WITH_S[kind], found[1], "s"),
        Bound(f"{kind}: a key sphere of {WIDTH} x {WIDTH // 2} in the map", KEY_MB, megabytes, "MB"),
    ]
