"""Calibration beside OpenCV's on the same corners, and of rigs that are known (`calibration_worlds`)."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks import calibration_reference
from benchmarks import calibration_worlds as worlds
from benchmarks.report import Bound, Report, Table
from rig_calibration.boards.board import Board
from rig_calibration.boards.detect import detect_all
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import CameraSpec, calibrate
from rig_calibration.params import CalibrationParams

HELP = "rig calibration beside OpenCV's, and of known rigs before projected and rendered boards"
PARTS = ("real", "projected", "driven", "rendered")
BOARD = Board("board", 9, 6, 0.1)
KEEP_ALL = CalibrationParams(corner_limit=1e6, view_ratio=1e6)  # plain squares over the very corners of the peer


def add_arguments(group: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    group.add_argument("--boards", type=Path, default=Path("../shared/data/checkerboard"), help="real board images")
    group.add_argument(
        "--calibration-parts", nargs="*", choices=PARTS, default=list(PARTS), help="parts to measure (all)"
    )
    group.add_argument(
        "--calibration-seeds", type=int, default=10, help="of projected corners (10); a third of it rendered"
    )


def run(options: argparse.Namespace) -> Report:
    """Measure the parts that were asked for."""
    report = Report("calibration")
    num_seeds = 2 if options.quick else options.calibration_seeds
    if "real" in options.calibration_parts:
        _real(report, options.boards)
    if "projected" in options.calibration_parts:
        worlds.projected(report, num_seeds)
    if "driven" in options.calibration_parts:
        worlds.driven(report)
    if "rendered" in options.calibration_parts:
        worlds.rendered(report, -(-num_seeds // 3), options.threads)
    return report


def _real(report: Report, folder: Path) -> None:
    """Measure both recorded sets beside OpenCV."""
    if not folder.is_dir():
        report.notes.append(f"recorded boards: skipped, no folder {folder}")
        return
    rows: list[tuple[str, ...]] = []
    stereo = _views(folder / "opencv_stereo", ("left", "right"))
    fisheye = _views(folder / "camodocal_fisheye", ("img",))
    for name, views, model, peer in (
        ("opencv_stereo", stereo, "pinhole", _stereo),
        ("camodocal_fisheye", fisheye, "fisheye", _fisheye),
    ):
        size = (640, 480) if model == "pinhole" else (1280, 960)
        theirs = peer(views, size)
        specs = [CameraSpec(camera, model, size) for camera in sorted({view.camera for view in views})]
        ours = calibrate(specs, (BOARD,), views, KEEP_ALL)
        rms = float(np.sqrt(np.mean(np.sum(ours.residuals**2, axis=-1))))
        lens = ", ".join(np.array2string(ours.camera(i).coefficients[:4], precision=2) for i in range(len(specs)))
        rows.append((name, f"{theirs:.5f}", f"{rms:.5f}", f"{len(ours.residuals)}", lens))
        report.bounds.append(Bound(f"{name}: RMS on the same corners by OpenCV's", 1.0001, rms / theirs, "x"))
    calibration_reference.compare(report, folder)
    report.tables.append(Table("RMS in px, all corners", ("images", "OpenCV", "ours", "corners", "fx fy cx cy"), rows))


def _views(folder: Path, names: tuple[str, ...]) -> list[BoardView]:
    views = []
    for name in names:
        for path in sorted(folder.glob(f"{name}[0-9]*.*g")):
            seen = detect_all(np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)), [BOARD]).get(BOARD.name)
            if seen is not None:
                views.append(BoardView(name, path.stem.removeprefix(name), BOARD.name, *seen))
    return views


def _corners(views: list[BoardView], camera: str) -> list[Any]:
    return [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views if view.camera == camera]


def _stereo(views: list[BoardView], size: tuple[int, int]) -> float:
    left, right = _corners(views, "left"), _corners(views, "right")
    points = [BOARD.points.astype(np.float32)] * len(left)
    lenses = [cv2.calibrateCamera(points, seen, size, None, None)[1:3] for seen in (left, right)]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
    return float(
        cv2.stereoCalibrate(points, left, right, *lenses[0], *lenses[1], size, flags=flags, criteria=criteria)[0]
    )


def _fisheye(views: list[BoardView], size: tuple[int, int]) -> float:
    seen = _corners(views, "img")
    points = [BOARD.points.reshape(1, -1, 3)] * len(seen)
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
    pixels = [item.astype(np.float64).reshape(1, -1, 2) for item in seen]
    K = np.array([[size[0] * 0.3, 0, size[0] / 2], [0, size[0] * 0.3, size[1] / 2], [0, 0, 1.0]])
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    return float(cv2.fisheye.calibrate(points, pixels, size, K, np.zeros((4, 1)), flags=flags, criteria=criteria)[0])
