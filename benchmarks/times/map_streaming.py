"""A walk of 1 km at 10 m/s past 300 key spheres of 2048 x 1024, read from the map as they are needed.

A thread tracks the camera, as the localiser does with every image: choose references, align, look ahead; others read,
prepare and choose pixels. It waits where the time that this takes is not its own. The place is a corridor whose walls
repeat from key sphere to key sphere, so that one picture serves them all and ten images the whole walk.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.room import hit_walls
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from sphere_nav.geometry import SE3, Camera, Pinhole, Spherical
from sphere_nav.photometric import build_pyramid, prepare_reference, register, warm_up
from sphere_nav.ros.maps.reader import MapReader, open_map, save_map
from sphere_nav.ros.run import return_free_memory, return_large_blocks, take_short_turns
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

HELP = "300 key spheres past a camera at 10 m/s: memory, waits, load and prepare"
SPHERE, CAMERA = Spherical(2048, 1024), Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5)
NUM_SPHERES, QUICK_SPHERES, NUM_IMAGES, NUM_TIMED = 300, 20, 10, 10  # images until the corridor repeats
SPEED, PERIOD_S, PATIENCE_S = 10.0, 1.0 / 30.0, 900.0
GUESS = SE3.exp([0.02, 0.01, -0.03, 0.003, 0.003, -0.003])  # what a prediction is off
GRAIN = 2.0  # standard deviation of the pictures' noise in grey levels: PNG cannot shrink it
WALK = "import sys; sys.path.append(sys.argv[2]); from benchmarks.times.map_streaming import walk; walk(sys.argv[1])"
CHECKOUT = str(Path(__file__).resolve().parents[2])
SPACING_M = 1000.0 / 300.0  # after which the walls repeat
HALF_SIDES_M = np.array([np.inf, 2.5, 2.0])
SIGHT_M, NUM_WAVES = 25.0, 24  # beyond it is haze, known to be far


def run(options: argparse.Namespace) -> Report:
    """Write the map, walk through it in a process of its own."""
    number = QUICK_SPHERES if options.size == "quick" else NUM_SPHERES
    with tempfile.TemporaryDirectory() as folder:
        path = _make_map(Path(folder), number, options.seed)
        megabytes = sum(file.stat().st_size for file in path.iterdir()) / 1e6 / number
        command = [sys.executable, "-P", "-c", WALK, str(path), CHECKOUT]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        if done.returncode:
            raise ValueError(f"walk: expected exit code 0, found {done.returncode}: {done.stderr[-500:]}")
        found = json.loads(done.stdout.splitlines()[-1])
    report = Report("map_streaming", notes=[__doc__ or ""])
    rows = [(name, f"{value:.4g}") for name, value in found.items()]
    report.tables.append(Table(f"{number} key spheres, {SPACING_M * number:.0f} m", ("what", "found"), rows))
    what, of = f"walk at 10 m/s past {number} key spheres", Headline("times and memory", "a drawn corridor")
    report.bounds = [
        Bound(f"{what}, largest resident memory", 400.0, found["rss_mb"], "MB", headline=of),
        Bound("the same, longest wait of the tracking thread", 2.0, found["wait_ms"], "ms"),
        Bound("the same, images aligned to small key spheres, none being ready", 0, found["num_coarse"], ""),
        Bound("load and prepare a key sphere 2048 x 1024, CPU, median", 60.0, found["prepare_ms"], "ms"),
        Bound("key sphere 2048 x 1024, colour and range, in the map", 10.0, megabytes, "MB"),
    ]
    return report


def _make_map(folder: Path, number: int, seed: int) -> Path:
    """Write a map of one picture under many ids."""
    gray, range_m = render(SPHERE, SE3.identity())
    rng = np.random.default_rng(seed)
    color = np.clip(gray[..., None] * [1.0, 0.9, 0.8] + rng.normal(0.0, GRAIN, (*gray.shape, 3)), 1, 255)
    sphere = Sphere(color.astype(np.uint8), range_m, SPHERE, 1)
    features = features_of_sphere(sphere)
    nodes = [KeySphere(i, i + 1, SE3.from_planar(SPACING_M * i, 0.0, 0.0)) for i in range(number)]
    appearance = AppearanceIndex()
    for node in nodes:
        appearance.add(node.id, features)
    return save_map(folder / "map", SphereGraph(nodes), load_sphere=lambda _: sphere, appearance=appearance)


# --- the corridor
def render(camera: Camera, T_corridor_camera: SE3, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the grey image (H, W) and the range along the ray (H, W) in metres; the corridor runs along x."""
    rays, range_m = hit_walls(camera, T_corridor_camera, HALF_SIDES_M)
    points = T_corridor_camera.translation + rays * np.minimum(range_m, SIGHT_M)[..., None]
    return _gray(points, range_m, np.random.default_rng(seed)), np.where(range_m > SIGHT_M, np.inf, range_m).astype(
        np.float32
    )


def _gray(points: NDArray[np.float64], range_m: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the sum of waves that have a whole number of periods from one key sphere to the next."""
    gray = np.zeros(points.shape[:-1])
    for frequency in np.geomspace(1.5, 40.0, NUM_WAVES):  # radians per metre
        direction = rng.normal(size=3)
        wave = frequency * direction / np.linalg.norm(direction)
        wave[0] = 2.0 * np.pi / SPACING_M * np.rint(wave[0] * SPACING_M / (2.0 * np.pi))
        gray += 30.0 / np.sqrt(frequency) * np.sin(points @ wave + rng.uniform(0.0, 2.0 * np.pi))
    return np.clip(np.rint(128.0 + np.where(range_m > SIGHT_M, 0.0, gray)), 1, 255).astype(np.uint8)


# --- the walk
def walk(path: str) -> None:
    """Walk through a map, print what it took as one line of JSON."""
    return_large_blocks()  # as every node does
    take_short_turns()
    warm_up()
    params = LocalizerParams()
    reader = open_map(path, is_gray=True)  # as the localiser does
    references = References(reader, params, is_live=True)
    return_free_memory()
    poses = [SE3.from_planar(SPEED * PERIOD_S * k, 0.0, 0.0) @ T_BODY_OPTICAL for k in range(NUM_IMAGES)]
    pyramids = [build_pyramid(render(CAMERA, pose)[0], CAMERA, params.registration.pyramid) for pose in poses]
    ways = [node.T_map_sphere.translation[0] for node in reader.graph]
    velocity = np.array([0.0, 0.0, SPEED, 0.0, 0.0, 0.0])
    references.choose(T_BODY_OPTICAL, CAMERA)  # the start may wait
    references.prefetch(T_BODY_OPTICAL, velocity)
    time.sleep(1.0)  # a vehicle does not start at full speed
    waits, steps, num_coarse, resident = list[float](), list[float](), 0, list[float]()
    errors = list[float]()
    begun = time.perf_counter()
    for index in range(int((ways[-1] - ways[0]) / SPEED / PERIOD_S)):
        time.sleep(max(0.0, begun + index * PERIOD_S - time.perf_counter()))
        pose = SE3.from_planar(SPEED * PERIOD_S * index, 0.0, 0.0) @ T_BODY_OPTICAL
        wall, cpu, switches = time.perf_counter(), time.thread_time(), _num_waits()
        choice = references.choose(pose, CAMERA, is_followed=True)
        found = register(pyramids[index % NUM_IMAGES], choice.views, pose @ GUESS, params.registration)
        references.prefetch(found.T_world_camera, velocity)
        steps.append(time.thread_time() - cpu)
        wait = (time.perf_counter() - wall) - steps[-1]
        waits.append(wait if _num_waits() > switches else 0.0)  # else another process had the core
        num_coarse += choice.views[0].reference.camera.width < SPHERE.width
        resident.append(_resident())
        errors.append(float(found.T_world_camera.distance(pose)[0]))
    references.close()
    row = {
        "rss_mb": max(resident),
        "rss_start_mb": resident[0],
        "wait_ms": 1e3 * max(waits),
        "wait_p99_ms": 1e3 * float(np.percentile(waits, 99)),
        "num_coarse": num_coarse,
        "step_ms": 1e3 * float(np.median(steps)),
        "step_p99_ms": 1e3 * float(np.percentile(steps, 99)),
    }
    print(json.dumps(row | {"error_mm": 1e3 * float(np.median(errors)), "prepare_ms": _prepare_ms(reader)}))


def _num_waits() -> int:
    """Return how often this thread has waited for anything."""
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw


def _resident() -> float:
    """Return the resident memory of this process in MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def _prepare_ms(reader: MapReader) -> float:
    """Return the median CPU time of reading and preparing one key sphere."""
    times = []
    for sphere_id in range(NUM_TIMED):
        begun = time.process_time()
        sphere = reader.load_sphere(sphere_id)
        prepare_reference(sphere.levels, sphere.range_m, sphere.camera, LocalizerParams().registration)
        times.append(1e3 * (time.process_time() - begun))
    return float(np.median(times))
