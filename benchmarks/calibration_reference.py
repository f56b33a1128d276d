"""Intrinsics of recorded boards beside the figures that came with them, and what these depend on.

The reference of `opencv_stereo` was made with corners refined in windows of +-11 px whatever their spacing; the page
of the data gives only its result. The same corners are made here once more, to see whether corners or estimator differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Report, Table
from rig_calibration.boards.board import Board
from rig_calibration.boards.detect import detect_all
from rig_calibration.boards.intrinsics import calibrate_camera
from rig_calibration.boards.observability import spread
from rig_calibration.boards.state import camera_problem
from rig_calibration.boards.views import observations
from rig_calibration.constants import REFINEMENT
from rig_calibration.params import CalibrationParams
from sphere_nav.geometry.arrays import Array

Gray = NDArray[np.uint8]

BOARD = Board("board", 9, 6, 0.1)
ALL, ROBUST = CalibrationParams(corner_limit=1e6, view_ratio=1e6), CalibrationParams()
REFERENCE_HALF_WINDOW = 11
SETS = (
    ("opencv_stereo", "left", "pinhole", (640, 480), (536.07, 536.01, 342.37, 235.53)),
    ("opencv_stereo", "right", "pinhole", (640, 480), (542.34, 541.60, 328.33, 246.96)),
    ("camodocal_fisheye", "img", "fisheye", (1280, 960), (383.28, 384.40, 639.36, 477.44)),
)
COLUMNS = ("images", "corners", "left out", "RMS in px", "fx fy cx cy", "std", "off in %", "off in std of fx")
MAX_OFF_PERCENT = 0.5


def compare(report: Report, folder: Path) -> None:
    """Add a table of intrinsics, and bounds on how far they are off."""
    rows: list[tuple[str, ...]] = []
    for name, camera, model, size, reference in SETS:
        images = [_gray(path) for path in sorted((folder / name).glob(f"{camera}[0-9]*.*g"))]
        seen = [answer[1] for image in images if (answer := detect_all(image, [BOARD]).get(BOARD.name))]
        label, truth = f"{name} {camera}", np.array(reference)
        row, off = _row(label, "as detected", model, size, seen, ROBUST, truth)
        rows.append(row)
        report.bounds.append(Bound(f"{label}: fx fy cx cy off the reference", MAX_OFF_PERCENT, off, "%"))
        if name == "opencv_stereo":
            wide = [_refined(image, corners) for image, corners in zip(images, seen, strict=True)]
            row, off = _row(label, "windows of ±11 px, all", model, size, wide, ALL, truth)
            rows.append(row)
            report.bounds.append(Bound(f"{label}: the same, at the reference's corners", MAX_OFF_PERCENT, off, "%"))
            rows.append(_row(label, "windows of ±11 px, those that fit", model, size, wide, ROBUST, truth)[0])
    report.tables.append(Table("Intrinsics, each camera by itself", COLUMNS, rows))


def _row(
    label: str,
    what: str,
    model: str,
    size: tuple[int, int],
    pixels: Sequence[Array],
    params: CalibrationParams,
    reference: Array,
) -> tuple[tuple[str, ...], float]:
    """Return the cells of a calibration, and the largest difference from the reference in percent."""
    count = len(pixels)
    seen = observations([0] * count, range(count), [0] * count, [BOARD.points] * count, list(pixels))
    found = calibrate_camera(model, size, seen, params)
    solution, kept = found.adjusted.solution, found.adjusted.kept
    problem = camera_problem(model, size, params.num_distortion, seen)
    std = spread(problem, solution.state, solution.residuals, kept).lens_std[0, :4]
    lens = found.camera.coefficients[:4]
    off = 100.0 * np.abs(lens / reference - 1.0)
    rms = float(np.sqrt(np.sum(solution.residuals[kept > 0] ** 2) / np.count_nonzero(kept)))
    cells = (_text(lens), _text(std), _text(off), f"{(lens[0] - reference[0]) / std[0]:.1f}")
    return (label, what, f"{np.count_nonzero(kept == 0)} of {len(kept)}", f"{rms:.3f}", *cells), float(off.max())


def _refined(image: Gray, corners: Array) -> Array:
    found = corners.astype(np.float32).reshape(-1, 1, 2).copy()
    cv2.cornerSubPix(image, found, (REFERENCE_HALF_WINDOW,) * 2, (-1, -1), REFINEMENT)
    return found.reshape(-1, 2).astype(np.float64)


def _gray(path: Path) -> Gray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def _text(values: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
