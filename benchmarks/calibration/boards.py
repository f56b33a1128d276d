"""Recorded boards: residuals beside OpenCV's on the same corners, intrinsics beside the figures that came with them.

The reference of `opencv_stereo` was made with corners refined in windows of +-11 px whatever their spacing. The same
corners are made here once more, to see whether corners or estimator differ.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
from rig_calibration.boards.board import Board
from rig_calibration.boards.detect import detect_all
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import CameraSpec, calibrate
from rig_calibration.constants import REFINEMENT
from rig_calibration.params import CalibrationParams
from sphere_nav.geometry.arrays import Array

HELP = "recorded boards: residuals beside OpenCV's, intrinsics beside published ones"
BOARD = Board("board", 9, 6, 0.1)
ALL, ROBUST = CalibrationParams(corner_limit=1e6, view_ratio=1e6), CalibrationParams()
HALF_WINDOW, MAX_OFF_PERCENT = 11, 0.5
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
SETS = (
    ("opencv_stereo", "left", "pinhole", (640, 480), (536.07, 536.01, 342.37, 235.53)),
    ("opencv_stereo", "right", "pinhole", (640, 480), (542.34, 541.60, 328.33, 246.96)),
    ("camodocal_fisheye", "img", "fisheye", (1280, 960), (383.28, 384.40, 639.36, 477.44)),
)


def run(options: argparse.Namespace) -> Report:
    """Measure both recorded sets."""
    report, rows, folder = Report("boards", notes=[__doc__ or ""]), [], options.data / "checkerboard"
    if not folder.is_dir():
        report.skipped = f"no folder {folder}"
        return report
    told = Headline("map", "checkerboard, camodocal_fisheye", "1 (OpenCV)")
    for name, model, size, peer in (
        ("opencv_stereo", "pinhole", (640, 480), _stereo),
        ("camodocal_fisheye", "fisheye", (1280, 960), _fisheye),
    ):
        views = [view for one, camera, *_ in SETS if one == name for view in _views(folder / name, camera)]
        specs = [CameraSpec(camera, model, size) for camera in dict.fromkeys(view.camera for view in views)]
        residuals = calibrate(specs, (BOARD,), views, ALL).residuals
        ratio = float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1)))) / peer(views, size)
        report.bounds.append(
            Bound(
                f"{name}: RMS on the same corners by OpenCV's",
                1.0001,
                ratio,
                "x",
                headline=told if model == "fisheye" else None,
            )
        )
    for name, camera, model, size, reference in SETS:
        ways = [("as detected", ROBUST, False)]
        ways += [("windows of 11 px", ALL, True)] if name == "opencv_stereo" else []
        for what, params, is_wide in ways:
            views = _views(folder / name, camera, is_wide)
            found = calibrate([CameraSpec(camera, model, size)], (BOARD,), views, params).camera(0).coefficients[:4]
            off = 100.0 * np.abs(found / np.array(reference) - 1.0)
            rows.append((f"{name} {camera}", what, *(f"{value:.2f}" for value in (*found, *off))))
            what = f"{name} {camera}, {what}: fx fy cx cy off the reference"
            report.bounds.append(Bound(what, MAX_OFF_PERCENT, float(off.max()), "%"))
    columns = ("images", "corners", "fx", "fy", "cx", "cy", "off in %", "fy", "cx", "cy")
    report.tables.append(Table("Intrinsics, each camera by itself", columns, rows))
    return report


def _views(folder: Path, camera: str, is_wide: bool = False) -> list[BoardView]:
    """Return what is detected, or the same corners refined as those of the reference were."""
    views = []
    for path in sorted(folder.glob(f"{camera}[0-9]*.*g")):
        image: NDArray[np.uint8] = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
        seen = detect_all(image, [BOARD]).get(BOARD.name)
        if seen is not None:
            numbers, pixels = seen
            pixels = _refined(image, pixels) if is_wide else pixels
            views.append(BoardView(camera, path.stem.removeprefix(camera), BOARD.name, numbers, pixels))
    return views


def _refined(image: NDArray[np.uint8], corners: Array) -> Array:
    found = corners.astype(np.float32).reshape(-1, 1, 2).copy()
    cv2.cornerSubPix(image, found, (HALF_WINDOW,) * 2, (-1, -1), REFINEMENT)
    return found.reshape(-1, 2).astype(np.float64)


def _corners(views: list[BoardView], camera: str) -> list[Any]:
    return [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views if view.camera == camera]


def _stereo(views: list[BoardView], size: tuple[int, int]) -> float:
    left, right = _corners(views, "left"), _corners(views, "right")
    points = [BOARD.points.astype(np.float32)] * len(left)
    lenses = [cv2.calibrateCamera(points, seen, size, None, None)[1:3] for seen in (left, right)]
    given: dict[str, Any] = {"flags": cv2.CALIB_USE_INTRINSIC_GUESS, "criteria": CRITERIA}
    return float(cv2.stereoCalibrate(points, left, right, *lenses[0], *lenses[1], size, **given)[0])


def _fisheye(views: list[BoardView], size: tuple[int, int]) -> float:
    pixels = [seen.astype(np.float64).reshape(1, -1, 2) for seen in _corners(views, "img")]
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
    K = np.array([[size[0] * 0.3, 0, size[0] / 2], [0, size[0] * 0.3, size[1] / 2], [0, 0, 1.0]])
    given: dict[str, Any] = {"flags": flags, "criteria": CRITERIA}
    points = [BOARD.points.reshape(1, -1, 3)] * len(pixels)
    return float(cv2.fisheye.calibrate(points, pixels, size, K, np.zeros((4, 1)), **given)[0])
