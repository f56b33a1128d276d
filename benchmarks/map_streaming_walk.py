"""The process of `map_streaming`: walks through a map at 10 m/s, prints what it took as one line of JSON."""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.corridor import render
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.photometric import build_pyramid, prepare_reference, register, warm_up
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.ros.run import return_free_memory, return_large_blocks, take_short_turns
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

CAMERA = Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5)
SPEED, PERIOD_S = 10.0, 1.0 / 30.0
MEGABYTE = 1e6
NUM_IMAGES = 10  # until the corridor repeats
GUESS = SE3.exp([0.02, 0.01, -0.03, 0.003, 0.003, -0.003])  # what a prediction is off
NUM_TIMED = 10
FULL_WIDTH = 2048


def main() -> None:
    """Walk, print."""
    return_large_blocks()  # as every node does
    take_short_turns()
    warm_up()
    loaded_mb = _resident()
    params = LocalizerParams()
    reader = open_map(sys.argv[1], is_gray=True)  # as the localiser does
    references = References(reader, params, is_live=True)
    return_free_memory()
    opened_mb = _resident()
    poses = [SE3.from_planar(SPEED * PERIOD_S * k, 0.0, 0.0) @ T_BODY_OPTICAL for k in range(NUM_IMAGES)]
    pyramids = [build_pyramid(render(CAMERA, pose)[0], CAMERA, params.registration.pyramid) for pose in poses]
    ways = [node.T_map_sphere.translation[0] for node in reader.graph]
    velocity = np.array([0.0, 0.0, SPEED, 0.0, 0.0, 0.0])
    references.choose(T_BODY_OPTICAL, CAMERA)  # the start may wait
    references.prefetch(T_BODY_OPTICAL, velocity)
    time.sleep(1.0)  # a vehicle does not start at full speed
    waits, steps, num_coarse, resident = list[float](), list[float](), 0, list[float]()
    blocked = list[float]()
    errors = list[float]()
    begun = time.perf_counter()
    for index in range(int((ways[-1] - ways[0]) / SPEED / PERIOD_S)):
        time.sleep(max(0.0, begun + index * PERIOD_S - time.perf_counter()))
        pose = SE3.from_planar(SPEED * PERIOD_S * index, 0.0, 0.0) @ T_BODY_OPTICAL
        wall, cpu, switches, queued = time.perf_counter(), time.thread_time(), _num_waits(), _queued_s()
        choice = references.choose(pose, CAMERA, is_followed=True)
        found = register(pyramids[index % NUM_IMAGES], choice.views, pose @ GUESS, params.registration)
        references.prefetch(found.T_world_camera, velocity)
        steps.append(time.thread_time() - cpu)
        wait = (time.perf_counter() - wall) - steps[-1]
        waits.append(wait if _num_waits() > switches else 0.0)  # else another process had the core
        blocked.append(max(0.0, wait - (_queued_s() - queued)))
        num_coarse += choice.views[0].reference.camera.width < FULL_WIDTH
        resident.append(_resident())
        errors.append(float(found.T_world_camera.distance(pose)[0]))
    references.close()
    row = {
        "rss_mb": max(resident),
        "rss_kernels_mb": loaded_mb,
        "rss_map_mb": opened_mb,
        "rss_start_mb": resident[0],
        "wait_ms": 1e3 * max(waits),
        "wait_p99_ms": 1e3 * float(np.percentile(waits, 99)),
        "blocked_ms": 1e3 * max(blocked),  # less what a core was waited for, which others may have had
        "blocked_p99_ms": 1e3 * float(np.percentile(blocked, 99)),
        "num_coarse": num_coarse,
        "step_ms": 1e3 * float(np.median(steps)),
        "step_p99_ms": 1e3 * float(np.percentile(steps, 99)),
    }
    print(json.dumps(row | {"error_mm": 1e3 * float(np.median(errors)), "prepare_ms": _prepare_ms(reader)}))


def _num_waits() -> int:
    """Return how often this thread has waited for anything."""
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw


def _queued_s() -> float:
    """Return how many seconds this thread has been ready to run without a core."""
    return int(Path("/proc/thread-self/schedstat").read_text(encoding="ascii").split()[1]) / 1e9


def _resident() -> float:
    """Return the resident memory of this process in MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / MEGABYTE


def _prepare_ms(reader: MapReader) -> float:
    """Return the median CPU time of reading and preparing one key sphere."""
    times = []
    for sphere_id in range(NUM_TIMED):
        begun = time.process_time()
        sphere = reader.load_sphere(sphere_id)
        prepare_reference(sphere.levels, sphere.range_m, sphere.camera, LocalizerParams().registration)
        times.append(1e3 * (time.process_time() - begun))
    return float(np.median(times))


if __name__ == "__main__":
    main()
