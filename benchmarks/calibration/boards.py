"""Recorded boards: residuals beside OpenCV's on the same corners."""

from __future__ import annotations

import argparse
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np

from benchmarks.report import Bound, Headline, Report
from rig_calibration.boards import rejection
from rig_calibration.boards.board import Board
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import CameraSpec, calibrate
from sphere_nav_tools.cli.calibrate import detect_boards

BOARD = Board("board", 9, 6, 0.1)
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
SETS = (  # model, size, cameras
    ("opencv_stereo", "pinhole", (640, 480), ("left", "right")),
    ("camodocal_fisheye", "fisheye", (1280, 960), ("img",)),
)


def run(options: argparse.Namespace) -> Report:
    """Measure both recorded sets."""
    report, folder = Report("boards", notes=[__doc__ or ""]), options.data / "checkerboard"
    if not folder.is_dir():
        report.skipped = f"no folder {folder}"
        return report
    told = Headline("map", "checkerboard, opencv_stereo and camodocal_fisheye", "1 (OpenCV)")
    for name, model, size, cameras in SETS:
        paths = {camera: sorted((folder / name).glob(f"{camera}[0-9]*.*g")) for camera in cameras}
        files = {camera: {path.stem.removeprefix(camera): path for path in found} for camera, found in paths.items()}
        _, views = detect_boards(files, (BOARD,))
        specs = [CameraSpec(camera, model, size) for camera in cameras]
        with patch.multiple(rejection, CORNER_LIMIT=1e6, VIEW_RATIO=1e6):  # all corners count, as they do there
            residuals = calibrate(specs, (BOARD,), views).residuals
        peer = (_stereo if len(cameras) > 1 else _fisheye)(views, size)
        ratio = float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1)))) / peer
        what = f"{name}: RMS on the same corners by OpenCV's"
        report.bounds.append(Bound(what, 1.0001, ratio, "x", headline=told))
    return report


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
