"""CPU times of the registration: one iteration, a pyramid, a reference, a whole registration (M15 table 1).

The yardstick is plain NumPy: by its time the other times can be compared from machine to machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import repeat_cpu
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.room import render
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.photometric import (
    PyramidParams,
    RegistrationParams,
    View,
    build_pyramid,
    prepare_reference,
    register,
)
from sphere_nav.photometric.align.problem import AlignmentState, Problem
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

HELP = "one iteration, pyramid, reference, whole localisation step, in ms and in yardsticks"
CAMERA, SPHERE = Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5), Spherical(2048, 1024)
NUM_PIXELS, NUM_ITERATIONS, NUM_RUNS, QUICK_RUNS = 60_000, 10, 100, 20
YARDSTICK = "yardstick: 20 x (a * b + c) of 60 000 float32, in NumPy"
START_ERROR = np.array([0.05, 0.05, 0.05, 0.01, 0.01, 0.01])  # of a localisation step: standard deviation, m and rad


def run(options: argparse.Namespace) -> Report:
    """Time every part on images of the same room."""
    num_runs = QUICK_RUNS if options.size == "quick" else NUM_RUNS
    image, _ = render(CAMERA, T_BODY_OPTICAL, options.seed)
    gray, range_m = render(SPHERE, SE3.identity(), options.seed)
    view, params = View(prepare_reference(gray, range_m, SPHERE), SE3.identity()), RegistrationParams()
    times = {
        "iteration, 60 000 px of a sphere": iteration_ms(image, view, num_runs),
        "pyramid 800 x 600": repeat_cpu(lambda: build_pyramid(image, CAMERA, params.pyramid), 5 * num_runs),
        "registration, 800 x 600, 60 000 px": step_ms(image, view, num_runs, options.seed),
        "reference 2048 x 1024": repeat_cpu(lambda: prepare_reference(gray, range_m, SPHERE), max(3, num_runs // 10)),
        YARDSTICK: repeat_cpu(yardstick(), num_runs),
    }
    unit = float(np.median(times[YARDSTICK]))
    rows = [(what, *(f"{x:.3g}" for x in (np.median(ms), np.percentile(ms, 99), np.median(ms) / unit)))
            for what, ms in times.items()]  # fmt: skip
    report = Report("kernel_times", notes=[__doc__ or ""])
    report.tables.append(Table("CPU times", ("what", "median ms", "p99 ms", "median in yardsticks"), rows))
    iteration, pyramid, step = (float(np.median(ms)) for ms in list(times.values())[:3])
    of = Headline("times and memory", "a drawn room", "M15: 1.13 ms on a laptop of 2011")
    report.bounds = [
        Bound("one iteration, 60 000 px", 0.3, iteration, "ms", headline=of),
        Bound("pyramid 800 x 600", 0.08, pyramid, "ms"),
        Bound("registration, one reference, median", 5.0, step, "ms"),
        Bound("registration, one reference, p99", 12.0, float(np.percentile(list(times.values())[2], 99)), "ms"),
    ]
    return report


def iteration_ms(image: NDArray[np.uint8], view: View, num_runs: int) -> NDArray[np.float64]:
    """Return times (num_runs,) of one of ten passes on the full image, all 60 000 pixels in view and compared."""
    params = RegistrationParams(pyramid=PyramidParams(num_levels=1), max_pixels=NUM_PIXELS)
    level = build_pyramid(image, CAMERA, params.pyramid).levels[0]
    problem = Problem.choose_pixels(level, [view], T_BODY_OPTICAL, params)
    state = AlignmentState.start(T_BODY_OPTICAL @ SE3.exp(START_ERROR), 1)

    def iterate() -> None:
        for _ in range(NUM_ITERATIONS):
            problem.linearize(state)

    return repeat_cpu(iterate, num_runs) / NUM_ITERATIONS


def step_ms(image: NDArray[np.uint8], view: View, num_runs: int, seed: int) -> NDArray[np.float64]:
    """Return times (num_runs,) from an image to its pose, started at random near the truth."""
    params, rng = RegistrationParams(max_pixels=NUM_PIXELS), np.random.default_rng(seed)

    def locate() -> SE3:
        start = T_BODY_OPTICAL @ SE3.exp(rng.normal(size=6) * START_ERROR)
        return register(build_pyramid(image, CAMERA, params.pyramid), [view], start, params).T_world_camera

    return repeat_cpu(locate, num_runs)


def yardstick() -> Callable[[], object]:
    """Return work that has nothing to do with us, by which machines compare."""
    a, b, c = np.random.default_rng(0).random((3, NUM_PIXELS), dtype=np.float32)
    out = np.empty_like(a)
    return lambda: [np.add(np.multiply(a, b, out=out), c, out=out) for _ in range(20)]
