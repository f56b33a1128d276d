"""Frame-to-frame registration of recorded RGB-D pairs, ours beside OpenCV's odometry, in one run.

All methods get the same grey images, depth and intrinsics, taken as from a global shutter, and start from no motion.
Errors are those of T_reference_current against COLMAP's poses.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rgbd_data import CAMERA, Frame, Recording
from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric import (
    PyramidParams,
    Reference,
    RegistrationParams,
    View,
    build_pyramid,
    prepare_reference,
    register,
)
from sphere_nav.photometric.align.problem import Problem, RigImage

GAPS, STEP, QUICK_STEP = (1, 5, 10), 5, 60  # frames apart, and between the starts of pairs
MAX_DEPTH_M, FAILURE_MM = 8.0, 50.0
MAX_MOTION_M, MAX_MOTION_DEG = 2.0, 90.0  # no peer shall refuse a pair for its motion alone
OURS = "sphere_nav"
NUM_WARM_UP, SETTLE_S = 2, 0.5  # pairs; for the threads of the method before to fall asleep
COLUMNS = ("k", "method", "median mm", "median °", "tracking ms", "> 50 mm")
# Images of a Kinect are soft: half their size carries what can be aligned, and a tenth of a pixel is below their noise.
SOFT_IMAGES = RegistrationParams(pyramid=PyramidParams(finest=1), max_pixels=20_000, min_step=0.1)
K = np.array([[CAMERA.fx, 0.0, CAMERA.cx], [0.0, CAMERA.fy, CAMERA.cy], [0.0, 0.0, 1.0]])


class Ours:
    """One reference, from no motion, as the localiser calls it; the depth of a new frame is not used."""

    name = OURS

    def __init__(self) -> None:
        self.range_by_depth = (1.0 / pixel_rays(CAMERA)[..., 2]).astype(np.float32)

    def prepare(self, frame: Frame) -> Reference:
        """Turn depth into range along the ray, prepare all levels of the reference and choose its pixels."""
        reference = prepare_reference(frame.gray, frame.depth_m * self.range_by_depth, CAMERA, SOFT_IMAGES)
        pyramid = build_pyramid(frame.gray, CAMERA, SOFT_IMAGES.pyramid)
        image = RigImage(pyramid, views=(View(reference, SE3.identity()),))
        for index in range(SOFT_IMAGES.pyramid.finest, len(pyramid.levels)):
            Problem.choose_pixels([image], index, SE3.identity(), SOFT_IMAGES)
        return reference

    def track(self, reference: Reference, frame: Frame) -> SE3 | None:
        """Build the pyramid of the new image and align it."""
        pyramid = build_pyramid(frame.gray, CAMERA, SOFT_IMAGES.pyramid)
        return register(pyramid, [View(reference, SE3.identity())], SE3.identity(), SOFT_IMAGES).T_world_camera


class OpenCVOdometry:
    """`cv2.Odometry` of OpenCV 5; its result maps points of the first frame into the second."""

    def __init__(self, mode: str) -> None:
        kind = {"RGB": cv2.OdometryType_RGB, "RGB-D": cv2.OdometryType_RGB_DEPTH}[mode]
        self.name = f"OpenCV {mode}"
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(K.astype(np.float32))
        settings.setMaxDepth(MAX_DEPTH_M)
        settings.setMaxTranslation(MAX_MOTION_M)
        settings.setMaxRotation(MAX_MOTION_DEG)
        self.odometry = cv2.Odometry(kind, settings, cv2.OdometryAlgoType_COMMON)

    def prepare(self, frame: Frame) -> Any:
        """Build pyramids, gradients, normals."""
        prepared = cv2.OdometryFrame(frame.depth_m, frame.gray)
        self.odometry.prepareFrame(prepared)
        return prepared

    def track(self, reference: Any, frame: Frame) -> SE3 | None:
        """Prepare the new frame, then align."""
        current = cv2.OdometryFrame(frame.depth_m, frame.gray)
        self.odometry.prepareFrames(reference, current)  # what the reference already has is not computed again
        is_found, T_current_reference = self.odometry.compute(reference, current)
        return SE3(np.asarray(T_current_reference, np.float64)).inverse() if is_found else None


Method = Ours | OpenCVOdometry


Figures = NDArray[np.float64]  # (N, 3) what one method did on N pairs: errors in mm and deg, time in ms


def run(options: argparse.Namespace) -> Report:
    """Measure every method; the first pair begins at a frame that the seed draws."""
    report = Report("frame_to_frame", notes=[__doc__ or ""])
    recording = Recording.open(options.data)
    if recording is None:
        return Report("frame_to_frame", skipped=f"no redkitchen with COLMAP's poses in {options.data}")
    methods: list[Method] = [Ours()]
    if hasattr(cv2, "OdometryFrame"):
        methods += [OpenCVOdometry("RGB"), OpenCVOdometry("RGB-D")]
    else:
        report.notes.append(f"OpenCV {cv2.__version__} has no Odometry (expected 5 or later): its rows are left out.")
    step, rows = QUICK_STEP if options.size == "quick" else STEP, list[tuple[str, ...]]()
    for gap in GAPS:
        figures = measure(methods, recording, gap, step, options.seed % step)
        for name, found in figures.items():
            mm, deg, ms = np.median(found, axis=0)
            failed = f"{num_failures(found)} of {len(found)}"
            rows.append((str(gap), name, f"{mm:.2f}", f"{deg:.3f}", f"{ms:.1f}", failed))
        report.bounds += bounds_of(figures, gap)
    report.tables.append(Table("Pairs k frames apart of redkitchen", COLUMNS, rows))
    return report


def measure(methods: list[Method], recording: Recording, gap: int, step: int, first: int) -> dict[str, Figures]:
    """Run one method after the other, as each would on a vehicle: threads of one that still spin stall the next."""
    figures = {}
    pairs = recording.pairs(gap, 1)[first::step]
    frames = {path: _cut(recording.frame(path)) for path in dict.fromkeys(sum(pairs, ()))}
    for method in methods:
        time.sleep(SETTLE_S)
        for _ in range(NUM_WARM_UP):
            method.track(method.prepare(frames[pairs[0][0]]), frames[pairs[0][0]])
        figures[method.name] = np.array([_measure_pair(method, frames[one], frames[other]) for one, other in pairs])
    return figures


def _cut(frame: Frame) -> Frame:
    return replace(frame, depth_m=np.where(frame.depth_m <= MAX_DEPTH_M, frame.depth_m, np.float32(np.nan)))


def _measure_pair(method: Method, reference: Frame, current: Frame) -> tuple[float, float, float]:
    prepared, start = method.prepare(reference), time.perf_counter_ns()
    T_reference_current = method.track(prepared, current)
    ms = (time.perf_counter_ns() - start) / 1e6
    T_true = reference.T_world_camera.inverse() @ current.T_world_camera
    meters, radians = T_true.distance(T_reference_current) if T_reference_current else (math.inf, math.inf)
    return 1e3 * float(meters), math.degrees(radians), ms


def num_failures(found: Figures) -> int:
    """Return how many pairs have more than 50 mm error, refused ones included."""
    return int(np.sum(found[:, 0] > FAILURE_MM))


def bounds_of(figures: dict[str, Figures], gap: int) -> list[Bound]:
    """Return our failures, and our error and time beside the best of the peers that are there."""
    ours, where = figures[OURS], f"k = {gap}"
    bounds = [Bound(f"failures, {where}", 0, num_failures(ours), "pairs")]
    others = {name: np.median(found, axis=0).tolist() for name, found in figures.items() if name != OURS}
    if not others:
        return bounds
    error, best = min((mm, name) for name, (mm, _, _) in others.items())
    time_ms, fastest = min((ms, name) for name, (_, _, ms) in others.items())
    (own_mm, _, own_ms), data = np.median(ours, axis=0).tolist(), f"redkitchen, pairs {gap} frames apart"
    of = Headline("frame to frame", data, f"{best}: {error:.2f} mm")
    of_time = Headline("frame to frame", data, f"{fastest}: {time_ms:.0f} ms") if gap == GAPS[0] else None
    return [
        *bounds,
        Bound(f"median error, {where}", error, own_mm, "mm", headline=of),
        Bound(f"tracking, fastest peer by ours, {where}", 10.0, time_ms / own_ms, "x", True, of_time),
    ]
