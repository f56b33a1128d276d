"""Where the time of a localisation goes: a drive through a room, image in, pose out, stage by stage.

CPU time is that of the thread that answers the images; the other thread prepares key spheres. The drive runs once on
one core and once on two.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.machine import describe, num_cores
from benchmarks.report import Bound, Report, Table
from benchmarks.room import render
from dense_localizer import inputs
from dense_localizer.judge import integrity
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.track import inter_frame
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.localization import InputCheck
from sphere_nav.photometric.align import rig
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

HELP = "a localisation at 800 x 600 stage by stage: CPU and wall time, one and two cores"
CAMERA = Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5)
SPHERE = Spherical(2048, 1024)
PERIOD_NS = 1_000_000_000 // 45
SPEED = 1.4  # m/s
START_X, END_X = -3.5, 2.5  # m in the room
SPACING = 1.0  # m between key spheres
SETTLE = 10  # images of the start, which is no tracking
STAGES: dict[str, tuple[Any, str]] = {
    "check of the image": (InputCheck, "check_image"),
    "pyramid": (inputs, "build_pyramid"),
    "is the rotation supported": (inter_frame, "measure_mismatch"),
    "choice of references": (References, "choose"),
    "choice of pixels": (rig.Problem, "choose_pixels"),
    "descents": (rig.Problem, "descend"),
    "overlap": (rig, "image_overlap"),
    "judgement of the alignment": (rig, "classify"),
    "judgement of the pose": (integrity, "assess"),
}


@dataclass
class RoomMap:
    """A map in memory."""

    graph: SphereGraph

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return a copy of a sphere, so that nothing of it is computed before."""
        sphere = self.graph[sphere_id].sphere
        assert sphere is not None
        return Sphere(sphere.image, sphere.range_m, sphere.camera, sphere.stamp_ns)

    def appearance(self) -> AppearanceIndex:
        """Return what they look like."""
        index = AppearanceIndex()
        for node in self.graph:
            index.add(node.id, features_of_sphere(self.load_sphere(node.id)))
        return index

    def coarse_spheres(self) -> Mapping[int, Sphere]:
        """Return all spheres small."""
        return {node.id: coarse_sphere(self.load_sphere(node.id)) for node in self.graph}


@dataclass
class Times:
    """Milliseconds of every image, and of every stage of it."""

    cpu: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)
    stages: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    errors_mm: list[float] = field(default_factory=list)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Nothing to choose."""


def run(options: argparse.Namespace) -> Report:
    """Drive on one core and on two."""
    poses = _poses()[: 6 * SETTLE if options.quick else None]
    images = [render(CAMERA, pose)[0] for pose in tqdm(poses, "images", leave=False, disable=None)]
    places = [SE3.from_planar(x, 0.1, 0.0) for x in np.arange(START_X, END_X + SPACING, SPACING)]
    nodes = [KeySphere(i, i + 1, T, Sphere(*render(SPHERE, T), SPHERE, i + 1)) for i, T in enumerate(places)]
    report = Report("localizer_times", notes=[describe(options.threads), __doc__ or ""])
    for cores in sorted({1, min(2, num_cores())}):
        with _cores(cores):
            times = _drive(RoomMap(SphereGraph(nodes)), images, poses)
        report.tables.append(_table(times, cores))
        report.bounds += _bounds(times, cores)
    return report


def _poses() -> list[SE3]:
    """Return the poses of the camera, weaving gently."""
    t = np.arange(0.0, (END_X - START_X) / SPEED, PERIOD_NS * 1e-9)
    x, y, yaw = START_X + SPEED * t, 0.3 * np.sin(t), 0.4 * np.sin(0.8 * t)
    return [SE3.from_planar(*row) @ T_BODY_OPTICAL for row in zip(x, y, yaw, strict=True)]


def _drive(room: RoomMap, images: list[NDArray[np.uint8]], poses: list[SE3]) -> Times:
    localizer, times = Localizer(LocalizerParams(), room), Times()
    localizer.relocalize(poses[0])
    with ExitStack() as stack:
        for name, (owner, function) in STAGES.items():
            stack.enter_context(_timed(owner, function, times.stages[name]))
        for index, (image, pose) in enumerate(zip(images, poses, strict=True)):
            counts = {name: len(stage) for name, stage in times.stages.items()}
            wall, cpu = time.perf_counter(), time.thread_time()
            estimate = localizer.update(image, CAMERA, (index + 1) * PERIOD_NS)
            cpu, wall = time.thread_time() - cpu, time.perf_counter() - wall
            for name, stage in times.stages.items():  # one sum an image
                stage[counts[name] :] = [sum(stage[counts[name] :])]
            times.cpu.append(1e3 * cpu)
            times.wall.append(1e3 * wall)
            found = estimate.T_map_camera
            times.errors_mm.append(1e3 * float(found.distance(pose)[0]) if found is not None else np.nan)
            time.sleep(max(0.0, PERIOD_NS * 1e-9 - wall))  # as the camera would: the other thread has its time
    localizer.references.close()
    return times


@contextmanager
def _timed(owner: Any, name: str, milliseconds: list[float]) -> Iterator[None]:
    """Note the CPU time of every call of a function while the context lasts."""
    given = owner.__dict__[name]
    function: Callable[..., Any] = given.__func__ if isinstance(given, staticmethod) else given

    def measured(*args: Any, **kwargs: Any) -> Any:
        begun = time.thread_time_ns()
        try:
            return function(*args, **kwargs)
        finally:
            milliseconds.append((time.thread_time_ns() - begun) * 1e-6)

    setattr(owner, name, staticmethod(measured) if isinstance(given, staticmethod) else measured)
    try:
        yield
    finally:
        setattr(owner, name, given)


@contextmanager
def _cores(number: int) -> Iterator[None]:
    """Keep the process, and the threads that it starts, on some cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:number])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _table(times: Times, cores: int) -> Table:
    rows: list[tuple[str, ...]] = [("whole, CPU", *_cells(times.cpu)), ("whole, wall", *_cells(times.wall))]
    rows += [(name, *_cells(stage)) for name, stage in times.stages.items()]
    title = f"{cores} core{'s' if cores > 1 else ''}, {len(times.cpu) - SETTLE} images of 800 x 600, ms"
    return Table(title, ("stage", "median", "p99"), rows)


def _cells(milliseconds: list[float]) -> tuple[str, str]:
    tracked = milliseconds[SETTLE:]
    return f"{np.median(tracked):.3g}", f"{np.percentile(tracked, 99):.3g}"


def _bounds(times: Times, cores: int) -> list[Bound]:
    cpu, on = times.cpu[SETTLE:], f"{cores} core{'s' if cores > 1 else ''}"
    return [
        Bound(f"localisation 800 x 600, two references, CPU, median, {on}", 5.0, float(np.median(cpu)), "ms"),
        Bound(f"localisation 800 x 600, two references, CPU, p99, {on}", 12.0, float(np.percentile(cpu, 99)), "ms"),
        Bound(f"error of these poses, median, {on}", 5.0, float(np.median(times.errors_mm[SETTLE:])), "mm"),
    ]
