"""How long a localiser takes from the start of its process to the first image that it answers, in a map of a hall.

The process is the node on an offline bus: everything but DDS. Once it has kernels compiled before, once it compiles
them. The map of 300 key spheres is made once and kept in the folder of temporary files.
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
from tqdm import tqdm

from benchmarks.localizer_times import CAMERA
from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from benchmarks.room import render
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

HELP = "from process start to the first answered image, 300 key spheres, kernels compiled or not"
SPHERE = Spherical(1024, 512)
COLUMNS, ROWS, SPACING = 30, 10, 0.3  # of key spheres in the room, m
WARM_S, COLD_S = 3.0, 25.0
RUNS = 3
PATIENCE = 600.0  # s
ANSWER = """
import sys
import numpy as np
from sensor_msgs.msg import CameraInfo, Image
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


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Nothing to choose."""


def run(options: argparse.Namespace) -> Report:
    """Start processes and wait for their answers."""
    path = Path(tempfile.gettempdir()) / f"sphere_nav_hall_{COLUMNS * ROWS}"
    if not path.is_dir():
        _make(path)
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "image.npy"
        np.save(image, render(CAMERA, SE3.from_planar(0.4, 0.1, 0.3) @ T_BODY_OPTICAL)[0])
        words = [str(path), str(image), *(str(v) for v in (CAMERA.width, CAMERA.height))]
        words += [str(v) for v in (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)]
        _answer(words, {})  # compiles what is not compiled, and reads the map into memory
        warm = [_answer(words, {}) for _ in range(RUNS)]
        cold = _answer(words, {"NUMBA_CACHE_DIR": str(Path(folder) / "kernels")})
    rows = [("kernels compiled", *_cells(one)) for one in warm] + [("nothing compiled", *_cells(cold))]
    report = Report("localizer_start", notes=[describe(options.threads), __doc__ or ""])
    report.tables.append(Table("From process start to the first answer", ("what", "wall s", "CPU s", "answer"), rows))
    report.bounds = [
        Bound("first answered image, 300 key spheres, kernels compiled", WARM_S, min(one[0] for one in warm), "s"),
        Bound("first answered image, 300 key spheres, nothing compiled", COLD_S, cold[0], "s"),
    ]
    return report


def _cells(one: tuple[float, float, str]) -> tuple[str, str, str]:
    return f"{one[0]:.2f}", f"{one[1]:.2f}", one[2]


def _answer(words: list[str], environment: dict[str, str]) -> tuple[float, float, str]:
    """Return wall and CPU time in s of a process that answers one image, and its answer."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command = [sys.executable, "-P", "-c", ANSWER, *words]
    done = subprocess.run(
        command, env=os.environ | environment, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    wall, after = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise ValueError(f"localizer: expected an answer, found {done.stderr.strip().splitlines()[-1:]}")
    return wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, done.stdout.strip()


def _make(path: Path) -> None:
    """Draw the key spheres and write the map."""
    graph = SphereGraph()
    for number in tqdm(range(COLUMNS * ROWS), "key spheres", leave=False, disable=None):
        x, y = SPACING * (number % COLUMNS - COLUMNS / 2), SPACING * (number // COLUMNS - ROWS / 2)
        T_map_sphere = SE3.from_planar(x, y, 0.0)
        sphere = Sphere(*render(SPHERE, T_map_sphere), SPHERE, number + 1)
        graph.add(KeySphere(number, number + 1, T_map_sphere, sphere))
    save_map(path, graph)
