"""CPU of one iteration, a pyramid, a whole localisation step and a key sphere of six cameras; a process's first answer.

The yardstick is plain NumPy: by its time the others compare from machine to machine. A step is what its own thread
computes; beside it stands what all threads do meanwhile, those that prepare key spheres included. A search is of all.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import repeat_cpu
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rig import images_along, rig_in_world
from benchmarks.room import MemoryMap, graph_of, look, make_room
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_mapping.acquisition.constants import NUM_INSTANTS
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.problem import AlignmentState, Problem, RigImage
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

CAMERA, SPHERE = Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5), Spherical(2048, 1024)
NUM_PIXELS, NUM_ITERATIONS, NUM_RUNS, QUICK_RUNS = 60_000, 10, 100, 20
START_ERROR = np.array([0.05, 0.05, 0.05, 0.01, 0.01, 0.01])  # of an iteration: standard deviation, m and rad
PERIOD_NS, SPEED, REACH_M, SETTLE = 1_000_000_000 // 45, 1.4, 3.0, 10  # of the drive; images of its start
PLACES = [SE3.from_planar(x, 0.1, 0.0) for x in np.arange(-REACH_M, REACH_M + 0.5)]  # of key spheres, a metre apart
INSTANTS, QUICK_INSTANTS, SPACING_M = 9, 4, 1.2
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
list(bus.advance(1_000_000_000))
bus.publish("/camera_info", camera_to_info(camera, 1_000_000_000, "camera"))
bus.publish("/image_raw", array_to_image(image, 1_000_000_000, "camera", "mono8"))
assert [item.message.state for item in bus.settle() if item.topic == "/status"]
"""


def run(options: argparse.Namespace) -> Report:
    """Time every part on images of the same room, and a rig in a town."""
    is_quick, room = options.size == "quick", make_room(options.seed)
    runs = QUICK_RUNS if is_quick else NUM_RUNS
    image = look(room, CAMERA, T_BODY_OPTICAL)[0]
    unit = repeat_cpu(yardstick(), runs)
    times = {"yardstick": unit, "iteration": iteration_ms(image, room, runs)}
    times["pyramid"] = repeat_cpu(lambda: build_pyramid(image, CAMERA, PyramidParams()), runs)
    steps, times["search"] = drive(room, SETTLE + runs, 3 if is_quick else 10)
    times["step"], times["all threads meanwhile"] = steps.T
    stitched, keyed = key_sphere(options.seed, QUICK_INSTANTS if is_quick else INSTANTS)
    times["stitched"], times["key sphere"] = stitched, keyed
    middle = {what: float(np.median(ms)) for what, ms in times.items()}
    rows = [(what, f"{middle[what]:.3g}", f"{np.percentile(ms, 99):.3g}", f"{middle[what] / middle['yardstick']:.3g}")
            for what, ms in times.items()]  # fmt: skip
    table = Table("CPU times", ("what", "median ms", "p99 ms", "yardsticks"), rows)
    of = Headline("times and memory", "a drawn room, 800 x 600; a rig in a town")
    whole = middle["stitched"] + middle["key sphere"]
    bounds = [
        Bound("iteration, 60 000 px", 1.2, middle["iteration"] / middle["yardstick"], "yardsticks", headline=of),
        Bound("localisation step, whole", 12.0, middle["step"] / middle["yardstick"], "yardsticks", headline=of),
        Bound("localisation step, CPU", 5.0, middle["step"], "ms"),
        Bound("search of an image, CPU", 100.0, middle["search"], "ms", headline=of),
        Bound("key sphere of six cameras, CPU", 800.0, whole, "ms", headline=of),
        Bound(
            "process start to the first answer, kernels compiled",
            3.0,
            first_answer_s(room, options.folder),
            "s",
            headline=of,
        ),
    ]
    return Report("step_times", [table], bounds, [__doc__ or ""])


def yardstick() -> Callable[[], object]:
    """Return work that has nothing to do with us: 20 x (a * b + c) of 60 000 float32."""
    a, b, c = np.random.default_rng(0).random((3, NUM_PIXELS), dtype=np.float32)
    out = np.empty_like(a)
    return lambda: [np.add(np.multiply(a, b, out=out), c, out=out) for _ in range(20)]


def iteration_ms(image: NDArray[np.uint8], room: Any, num_runs: int) -> NDArray[np.float64]:
    """Return times (num_runs,) of one of ten passes on the full image, all 60 000 pixels in view and compared."""
    gray, range_m = look(room, SPHERE, SE3.identity())
    view = View(prepare_reference(gray, range_m, SPHERE), SE3.identity())
    params = RegistrationParams(pyramid=PyramidParams(num_levels=1), max_pixels=NUM_PIXELS)
    seen = RigImage(build_pyramid(image, CAMERA, params.pyramid), views=(view,))
    problem = Problem.choose_pixels([seen], 0, T_BODY_OPTICAL, params)
    state = AlignmentState.start(T_BODY_OPTICAL @ SE3.exp(START_ERROR), 1)
    return repeat_cpu(lambda: [problem.compare(state) for _ in range(NUM_ITERATIONS)], num_runs) / NUM_ITERATIONS


def drive(room: Any, num_images: int, num_searches: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return CPU ms (N, 2) of a drive's images but for its start, by own and by all threads; of first images by all."""
    localizer = Localizer(LocalizerParams(), MemoryMap(graph_of(room, SPHERE, PLACES)))
    t = 1e-9 * PERIOD_NS * np.arange(num_images)
    way = np.stack([-REACH_M + SPEED * t, 0.3 * np.sin(t), 0.4 * np.sin(0.8 * t)], axis=-1)
    images = [look(room, CAMERA, SE3.from_planar(*row) @ T_BODY_OPTICAL)[0] for row in way]
    localizer.relocalize(SE3.from_planar(*way[0]) @ T_BODY_OPTICAL)
    steps = [_clocked(localizer, image, index + 1) for index, image in enumerate(images)]
    searches = []
    for number, image in enumerate(images[:: len(images) // num_searches][:num_searches]):
        localizer.reset()
        searches.append(_clocked(localizer, image, 10_000 + 100 * number)[1])
    localizer.references.close()
    return np.array(steps[SETTLE:]), np.array(searches)


def _clocked(localizer: Localizer, image: NDArray[np.uint8], number: int) -> tuple[float, float]:
    own, all_threads = time.thread_time(), time.process_time()
    localizer.update(image, CAMERA, number * PERIOD_NS)
    return 1e3 * (time.thread_time() - own), 1e3 * (time.process_time() - all_threads)


def key_sphere(seed: int, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return CPU times in ms of stitching the vertical rig's instants, and of placing them in a map."""
    simulator, rig = rig_in_world(seed, SPHERE.width, {})
    stitcher, mapper = Stitcher(rig, build(StitchParams, {"width": SPHERE.width})), Mapper(MapperParams())
    before, stitched, placed = cv2.getNumThreads(), [], []
    cv2.setNumThreads(1)
    instants = list(images_along(simulator, number, SPACING_M))
    for images in (instants * NUM_INSTANTS)[:NUM_INSTANTS]:  # makes the tables of the rig, learns the lenses' falloff
        stitcher.stitch(images)
    for index, images in enumerate(instants):
        begun = time.process_time()
        sphere = stitcher.stitch(images, index + 1)
        middle = time.process_time()
        mapper.add(sphere)
        stitched.append(1e3 * (middle - begun))
        if index:  # the first one is not registered
            placed.append(1e3 * (time.process_time() - middle))
    cv2.setNumThreads(before)
    return np.array(stitched), np.array(placed)


def first_answer_s(room: Any, folder: Path) -> float:
    """Return the wall time in s of a process that opens a map and answers one image, its kernels compiled."""
    save_map(folder / "map", graph_of(room, Spherical(1024, 512), PLACES))
    np.save(folder / "image.npy", look(room, CAMERA, SE3.from_planar(0.4, 0.1, 0.3) @ T_BODY_OPTICAL)[0])
    lens = (CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    words = [sys.executable, "-P", "-c", ANSWER, str(folder / "map"), str(folder / "image.npy"), *map(str, lens)]
    seconds = []
    for _ in range(2):  # the first one compiles what is not compiled
        begun = time.monotonic()
        subprocess.run(words, check=True, timeout=600.0)
        seconds.append(time.monotonic() - begun)
    return seconds[-1]
