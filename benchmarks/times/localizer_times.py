"""CPU and wall time of an image in the localiser, and from the start of its process to its first answer.

A drive through a room at 45 Hz. CPU time is that of the thread that answers the images; the other one prepares key
spheres. The process is the node on an offline bus, everything but DDS, in a map of a hall; once it has kernels compiled
before, once it compiles them.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.room import MemoryMap, Room
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

HELP = "a localisation at 800 x 600: CPU and wall time; from process start to the first answered image"
CAMERA = Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5)
SPHERE, SMALL_SPHERE = Spherical(2048, 1024), Spherical(1024, 512)
PERIOD_NS = 1_000_000_000 // 45
SPEED, START_X, END_X, SPACING = 1.4, -3.5, 2.5, 1.0  # m/s; m in the room; m between key spheres
SETTLE, QUICK_IMAGES = 10, 60  # images of the start, which is no tracking
COLUMNS, ROWS, QUICK_ROWS, HALL_SPACING = 30, 10, 1, 0.3  # of key spheres in the hall, m
WARM_S, COLD_S, PATIENCE_S = 3.0, 25.0, 600.0
ANSWER = """
import sys
import numpy as np
from dense_localizer.ros.node import DenseLocalizerNode
from sphere_nav.ros.conversions import array_to_image, camera_to_info
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.geometry import Pinhole
bus = OfflineBus(captured={"status"})
bus.add(DenseLocalizerNode, {"map": sys.argv[1], "base_frame": "camera"})
image, camera = np.load(sys.argv[2]), Pinhole(*map(float, sys.argv[3:]))
stamp = 1_000_000_000
list(bus.advance(stamp))
bus.publish("/camera_info", camera_to_info(camera, stamp, "camera"))
bus.publish("/image_raw", array_to_image(image, stamp, "camera", "mono8"))
said = [item.message for item in bus.settle() if item.topic == "/status"]
print(said[-1].state, said[-1].reason)
"""


def run(options: argparse.Namespace) -> Report:
    """Drive through the room; start processes and wait for their answers."""
    report, is_quick, room = (
        Report("localizer_times", notes=[__doc__ or ""]),
        options.size == "quick",
        Room(options.seed),
    )
    cpu, wall, errors_mm = drive(room, QUICK_IMAGES if is_quick else None)
    rows = [(what, *(f"{x:.3g}" for x in (np.median(ms), np.percentile(ms, 99))))
            for what, ms in (("CPU, ms", cpu), ("wall, ms", wall), ("error, mm", errors_mm))]  # fmt: skip
    report.tables.append(Table(f"{len(cpu)} images of 800 x 600, two references", ("what", "median", "p99"), rows))
    of = Headline("times and memory", "a drawn room, 45 Hz")
    report.bounds += [
        Bound("localisation 800 x 600, CPU, median", 5.0, float(np.median(cpu)), "ms", headline=of),
        Bound("localisation 800 x 600, CPU, p99", 12.0, float(np.percentile(cpu, 99)), "ms"),
        Bound("error of these poses, median", 5.0, float(np.median(errors_mm)), "mm"),
    ]
    start_processes(room, QUICK_ROWS if is_quick else ROWS, report)
    return report


def drive(room: Room, num_images: int | None) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return CPU and wall times in ms, and errors in mm, of the images of a drive, those of its start left out."""
    t = np.arange(0.0, (END_X - START_X) / SPEED, PERIOD_NS * 1e-9)[:num_images]
    x, y, yaw = START_X + SPEED * t, 0.3 * np.sin(t), 0.4 * np.sin(0.8 * t)  # weaving gently
    poses = [SE3.from_planar(*row) @ T_BODY_OPTICAL for row in zip(x, y, yaw, strict=True)]
    places = [SE3.from_planar(x, 0.1, 0.0) for x in np.arange(START_X, END_X + SPACING, SPACING)]
    nodes = [KeySphere(i, i + 1, T, Sphere(*room.render(SPHERE, T), SPHERE, i + 1)) for i, T in enumerate(places)]
    localizer, rows = Localizer(LocalizerParams(), MemoryMap(SphereGraph(nodes))), []
    localizer.relocalize(poses[0])
    for index, pose in enumerate(poses):
        image = room.render(CAMERA, pose)[0]
        wall, cpu = time.perf_counter(), time.thread_time()
        found = localizer.update(image, CAMERA, (index + 1) * PERIOD_NS).T_map_camera
        cpu, wall = time.thread_time() - cpu, time.perf_counter() - wall
        rows.append((1e3 * cpu, 1e3 * wall, 1e3 * float(found.distance(pose)[0]) if found is not None else np.nan))
    localizer.references.close()
    found_cpu, found_wall, errors = np.array(rows[SETTLE:]).T
    return found_cpu, found_wall, errors


# --- the process
def start_processes(room: Room, num_rows: int, report: Report) -> None:
    """Add how long a process takes to its first answer."""
    number = COLUMNS * num_rows
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_hall(room, folder / "map", num_rows)
        np.save(folder / "image.npy", room.render(CAMERA, SE3.from_planar(0.4, 0.1, 0.3) @ T_BODY_OPTICAL)[0])
        lens = (CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
        words = [str(folder / "map"), str(folder / "image.npy"), *map(str, lens)]
        first, warm = answer(words, {}), answer(words, {})  # the first one compiles what is not compiled
        cold = answer(words, {"NUMBA_CACHE_DIR": str(folder / "kernels")})
    rows = [(what, f"{one[0]:.2f}", f"{one[1]:.2f}", one[2])
            for what, one in (("first", first), ("kernels compiled", warm), ("nothing compiled", cold))]  # fmt: skip
    title = f"From process start to the first answer, {number} key spheres"
    report.tables.append(Table(title, ("what", "wall s", "CPU s", "answer"), rows))
    of = Headline("times and memory", f"a hall of {number} key spheres")
    report.bounds += [
        Bound("process start to the first answer, kernels compiled", WARM_S, warm[0], "s", headline=of),
        Bound("process start to the first answer, nothing compiled", COLD_S, cold[0], "s"),
    ]


def answer(words: list[str], environment: dict[str, str]) -> tuple[float, float, str]:
    """Return wall and CPU time in s of a process that answers one image, and its answer."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command, given = [sys.executable, "-P", "-c", ANSWER, *words], os.environ | environment
    done = subprocess.run(command, env=given, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    wall, after = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise ValueError(f"localizer: expected an answer, found {done.stderr.strip().splitlines()[-1:]}")
    return wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, done.stdout.strip()


def make_hall(room: Room, path: Path, num_rows: int) -> None:
    """Draw the key spheres and write the map."""
    graph = SphereGraph()
    for number in range(COLUMNS * num_rows):
        x = HALL_SPACING * (number % COLUMNS - COLUMNS / 2)
        T_map_sphere = SE3.from_planar(x, HALL_SPACING * (number // COLUMNS - num_rows / 2), 0.0)
        sphere = Sphere(*room.render(SMALL_SPHERE, T_map_sphere), SMALL_SPHERE, number + 1)
        graph.add(KeySphere(number, number + 1, T_map_sphere, sphere))
    save_map(path, graph)
