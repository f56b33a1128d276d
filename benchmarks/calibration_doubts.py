"""Sets of board images that are bad in one way, and good ones: does `calibrate` warn of the bad ones by name, only?"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.board_world import BoardWorld
from benchmarks.report import Bound, Report, Table
from rig_calibration.boards.board import Board
from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav_tools.cli.main import main

HELP = "bad sets of board images (blur, wrong size, few, frontal, one side) warned of by name; good ones not"
WORDS = {
    "blur": "blurred",
    "wrong size": "wrong board size",
    "few": "few views",
    "frontal": "no tilt",
    "one side": "one side only",
}
SIZES = ((640, 480), (800, 600), (960, 720))
BOARDS = ((9, 6), (8, 5), (7, 6), (10, 7))
SQUARE_M = 0.05
GOOD_VIEWS, FEW_VIEWS = (18, 26), (5, 8)
BLUR_PX = (2.5, 4.0)  # by the width of 1000 px; on top of the 0.7 px of the lens
TILT_DEG, FRONTAL_DEG = (12.0, 35.0), 2.0
EXTENT = (0.28, 0.45)  # of the image's width that a board takes
NUM_SETS = 20


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--set-seeds", type=int, default=101, help="the first one of the sets' seeds (101)")
    parser.add_argument("--set-count", type=int, default=NUM_SETS, help="sets of each, good and bad (20)")


def run(options: argparse.Namespace) -> Report:
    """Render, calibrate by the command, compare what it says."""
    report, rows = Report("calibration_doubts"), []
    count = 5 if options.quick else options.set_count
    found = {"bad": 0, "good": 0}
    for number in range(count):
        seed = options.set_seeds + number
        for flaw in (list(WORDS)[seed % len(WORDS)], ""):
            lines, focal_error = _calibrated(flaw, seed)
            warned = [word for word in WORDS.values() if any(word in line for line in lines)]
            is_right = WORDS[flaw] in warned if flaw else not lines
            found["bad" if flaw else "good"] += is_right
            told = "; ".join(lines)[:150] or "-"
            rows.append((flaw or "good", str(seed), focal_error, "yes" if is_right else "NO", told))
    report.tables.append(Table("Sets", ("set", "seed", "focal length off", "right", "warnings"), rows))
    for kind, right in found.items():
        what = "warned of by name" if kind == "bad" else "without a warning"
        report.bounds.append(Bound(f"{count} {kind} sets, {what}", count, right, "", is_minimum=True))
    return report


def _calibrated(flaw: str, seed: int) -> tuple[list[str], str]:
    """Return the warnings of `sphere_nav calibrate` about a set, or its error, and how far the focal length is off."""
    rng = np.random.default_rng([seed, 53 + (["", *WORDS].index(flaw))])
    camera, board = _lens(rng), Board("board", *BOARDS[rng.integers(len(BOARDS))], SQUARE_M)
    low, high = FEW_VIEWS if flaw == "few" else GOOD_VIEWS
    poses = board_poses(camera, board, int(rng.integers(low, high)), flaw, rng)
    rig = Rig((RigCamera("cam", camera, SE3.identity()),), "one")
    world = BoardWorld(rig, (board,), SE3(np.eye(4)[None]), poses.inverse())
    extra = rng.uniform(*BLUR_PX) * camera.width / 1000 if flaw == "blur" else 0.0
    given = (
        (board.columns - 1, board.rows - 1 + int(rng.integers(2)))
        if flaw == "wrong size"
        else (board.columns, board.rows)
    )
    with tempfile.TemporaryDirectory() as folder:
        images = Path(folder) / "cam"
        images.mkdir()
        for number in range(len(poses.matrix)):
            image = world.render(0, number, rng)
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), extra), np.uint8) if extra else image
            cv2.imwrite(str(images / f"{number:03d}.png"), image)
        size, out = f"{given[0]}x{given[1]}", str(Path(folder) / "rig.yaml")
        command = ["calibrate", str(images), "--board", size, "--square", str(SQUARE_M), "--model", camera.model]
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            status = main([*command, "-o", out])
        focal = _focal(Path(out)) if status == 0 else float("nan")
    lines = [line for line in said.getvalue().splitlines() if line.startswith("warning: ") and "left out" not in line]
    lines = lines if status == 0 else [*lines, said.getvalue().strip().splitlines()[-1]]
    return lines, f"{100 * (focal / camera.coefficients[0] - 1):+.2f} %"


def _focal(path: Path) -> float:
    from sphere_nav.geometry.files.rig_file import read_rig

    return float(read_rig(path).cameras[0].camera.coefficients[0])


def _lens(rng: np.random.Generator) -> Camera:
    width, height = SIZES[rng.integers(len(SIZES))]
    cx, cy = 0.5 * width + rng.uniform(-8, 8), 0.5 * height + rng.uniform(-8, 8)
    if rng.random() < 0.3:
        focal = width * rng.uniform(0.4, 0.55)
        return Fisheye(width, height, focal, 1.001 * focal, cx, cy, (rng.uniform(-0.03, 0.03), -0.01, 0.003, -0.0005))
    focal = width * rng.uniform(0.6, 1.1)
    distortion = (rng.uniform(-0.25, 0.05), rng.uniform(0.0, 0.08), 1e-4, -2e-4, 0.0)
    return Pinhole(width, height, focal, 0.999 * focal, cx, cy, distortion)


def board_poses(camera: Camera, board: Board, count: int, flaw: str, rng: np.random.Generator) -> SE3:
    """Return T_camera_board (count,) with the whole board in the image, in the part of it that the flaw leaves."""
    low, high = np.zeros(2), np.array([camera.width, camera.height], float)
    if flaw == "one side":
        axis, side = rng.integers(2), rng.integers(2)
        low[axis], high[axis] = (0.0, 0.55 * high[axis]) if side else (0.45 * high[axis], high[axis])
    extent = np.array([board.columns + 1, board.rows + 1]) * SQUARE_M
    poses: list[Array] = []
    shrink = 1.0 if flaw != "one side" else 0.8
    while len(poses) < count:
        target = rng.uniform(low, high)
        angle = np.radians(FRONTAL_DEG * rng.random() if flaw == "frontal" else rng.uniform(*TILT_DEG))
        about = rng.uniform(0, 2 * np.pi)
        turn = so3.exp(angle * np.array([np.cos(about), np.sin(about), 0.0])) @ so3.exp([0, 0, rng.normal(0, 0.1)])
        ray = camera.unproject(target)
        distance = camera.pixels_per_radian * extent[0] / (shrink * rng.uniform(*EXTENT) * camera.width)
        T = SE3.from_parts(turn, distance * ray - turn @ board.points.mean(axis=0))
        pixels, is_seen = camera.project(T.apply(board.points))
        if is_seen.all() and np.all((pixels > low + 8) & (pixels < high - 8)):
            poses.append(T.matrix)
    return SE3(np.stack(poses))
