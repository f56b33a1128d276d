"""CPU times of the registration: one iteration, a pyramid, a reference, a whole registration (M15 table 1).

The yardstick is plain NumPy: by its time the other times can be compared from machine to machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe, repeat_cpu
from benchmarks.report import Bound, Report, Table
from benchmarks.room import render
from sphere_nav.geometry import SE3, Camera, Pinhole, Spherical
from sphere_nav.photometric import (
    PyramidParams,
    Reference,
    RegistrationParams,
    View,
    build_pyramid,
    prepare_reference,
    register,
)
from sphere_nav.photometric.align.problem import AlignmentState, Problem

HELP = "one iteration, pyramid, reference, whole localisation step"
CAMERA = Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5)
SPHERE = Spherical(2048, 1024)
REFERENCE_CAMERAS: dict[str, Camera] = {
    "sphere 2048 x 1024": SPHERE,
    "sphere 1024 x 512": Spherical(1024, 512),
    "RGB-D 640 x 480": Pinhole(640, 480, 525.0, 525.0, 319.5, 239.5),
}
T_SPHERE_OPTICAL = SE3.from_parts([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])  # x forward from z forward
NUM_PIXELS = 60_000
NUM_ITERATIONS = 10
YARDSTICK = "yardstick: 20 x (a * b + c) of 60 000 float32, in NumPy"
START_ERROR = np.array([0.05, 0.05, 0.05, 0.01, 0.01, 0.01])  # of a localisation step: standard deviation, m and rad


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Nothing to choose."""


def run(options: argparse.Namespace) -> Report:
    """Time every part on images of the same room."""
    num_runs = 20 if options.quick else 100
    image, _ = render(CAMERA, T_SPHERE_OPTICAL)
    references = {name: _reference(camera) for name, camera in REFERENCE_CAMERAS.items()}
    view = View(references["sphere 2048 x 1024"], SE3.identity())
    pyramid = RegistrationParams().pyramid
    times = {
        "one iteration, 60 000 px of a sphere, 800 x 600 pinhole": _iteration_ms(image, view, num_runs),
        "pyramid 800 x 600": repeat_cpu(lambda: build_pyramid(image, CAMERA, pyramid), 10 * num_runs),
        "localisation step, 800 x 600, 60 000 px": _step_ms(image, view, num_runs),
    }
    for name, camera in REFERENCE_CAMERAS.items():
        times[f"prepare_reference, {name}"] = repeat_cpu(
            partial(_prepare, camera, *_view_of(camera)), max(3, num_runs // 10)
        )
    times[YARDSTICK] = repeat_cpu(yardstick(), num_runs)
    report = Report("kernel_times", notes=[describe(options.threads), __doc__ or ""])
    report.tables.append(Table("Times", ("what", "median ms", "p99 ms"), [_row(*item) for item in times.items()]))
    report.bounds = _bounds(times)
    return report


def _view_of(camera: Camera) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    return render(camera, SE3.identity() if isinstance(camera, Spherical) else T_SPHERE_OPTICAL)


def _prepare(camera: Camera, image: NDArray[np.uint8], range_m: NDArray[np.float32]) -> Reference:
    return prepare_reference(image, range_m, camera, RegistrationParams())


def _reference(camera: Camera) -> Reference:
    return _prepare(camera, *_view_of(camera))


def _iteration_ms(image: NDArray[np.uint8], view: View, num_runs: int) -> NDArray[np.float64]:
    """Return times (num_runs,) of one of ten passes on the full image, all 60 000 pixels in view and compared."""
    params = RegistrationParams(pyramid=PyramidParams(num_levels=1), max_pixels=NUM_PIXELS)
    level = build_pyramid(image, CAMERA, params.pyramid).levels[0]
    problem = Problem.choose_pixels(level, [view], T_SPHERE_OPTICAL, params)
    state = AlignmentState.start(T_SPHERE_OPTICAL @ SE3.exp(START_ERROR), 1)

    def iterate() -> None:
        for _ in range(NUM_ITERATIONS):
            problem.linearize(state)

    return repeat_cpu(iterate, num_runs) / NUM_ITERATIONS


def _step_ms(image: NDArray[np.uint8], view: View, num_runs: int) -> NDArray[np.float64]:
    """Return times (num_runs,) from an image to its pose, started at random near the truth."""
    params = RegistrationParams(max_pixels=NUM_PIXELS)
    rng = np.random.default_rng(0)
    starts = [T_SPHERE_OPTICAL @ SE3.exp(rng.normal(size=6) * START_ERROR) for _ in range(num_runs)]
    queue = iter([*starts[:3], *starts])
    return repeat_cpu(lambda: _locate(image, view, next(queue), params), num_runs, 3)


def _locate(image: NDArray[np.uint8], view: View, start: SE3, params: RegistrationParams) -> SE3:
    return register(build_pyramid(image, CAMERA, params.pyramid), [view], start, params).T_world_camera


def yardstick() -> Callable[[], object]:
    """Return work that has nothing to do with us, by which machines compare."""
    a, b, c = np.random.default_rng(0).random((3, NUM_PIXELS), dtype=np.float32)
    out = np.empty_like(a)
    return lambda: [np.add(np.multiply(a, b, out=out), c, out=out) for _ in range(20)]


def _row(what: str, ms: NDArray[np.float64]) -> tuple[str, str, str]:
    return what, f"{np.median(ms):.3g}", f"{np.percentile(ms, 99):.3g}"


def _bounds(times: dict[str, NDArray[np.float64]]) -> list[Bound]:
    iteration, pyramid, step = list(times.values())[:3]
    return [
        Bound("one iteration, 60 000 px", 0.3, float(np.median(iteration)), "ms"),
        Bound("one iteration, 60 000 px, fastest", 0.3, float(np.min(iteration)), "ms"),
        Bound("pyramid 800 x 600", 0.08, float(np.median(pyramid)), "ms"),
        Bound("pyramid 800 x 600, fastest", 0.08, float(np.min(pyramid)), "ms"),
        Bound("registration, one reference, median", 5.0, float(np.median(step)), "ms"),
        Bound("registration, one reference, p99", 12.0, float(np.percentile(step, 99)), "ms"),
    ]
