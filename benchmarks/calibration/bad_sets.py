"""Sets of board images that are bad in one way, and good ones: does `calibrate` warn of the bad ones by name, only?"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.report import Bound, Report, Table
from cycab_sim.world.boards import BoardWorld, board_poses
from rig_calibration.boards.board import Board
from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav_tools.cli.main import main

HELP = "board images that are blurred, few, frontal, one-sided or of a wrong size are warned of by name"
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
COUNTS = {"quick": 3, "full": 20}  # sets of each kind


def run(options: argparse.Namespace) -> Report:
    """Render, calibrate by the command, compare what it says."""
    report, rows, count = Report("bad_sets"), [], COUNTS[options.size]
    right = {"bad": 0, "good": 0}
    for seed in range(options.seed, options.seed + count):
        for flaw in (list(WORDS)[seed % len(WORDS)], ""):
            lines, focal_error = _calibrated(flaw, seed)
            is_right = any(WORDS[flaw] in line for line in lines) if flaw else not lines
            right["bad" if flaw else "good"] += is_right
            rows.append((flaw or "good", str(seed), focal_error, "yes" if is_right else "NO", "; ".join(lines)[:150]))
    report.tables.append(Table("Sets", ("set", "seed", "focal length off", "right", "warnings"), rows))
    for kind, found in right.items():
        what = "warned of by name" if kind == "bad" else "without a warning"
        report.bounds.append(Bound(f"{count} {kind} sets, {what}", count, found, "", is_minimum=True))
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
    given = (board.columns, board.rows)
    if flaw == "wrong size":
        given = (board.columns - 1, board.rows - 1 + int(rng.integers(2)))
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
        focal = read_rig(Path(out)).cameras[0].camera.coefficients[0] if status == 0 else np.nan
    lines = [line for line in said.getvalue().splitlines() if line.startswith("warning: ") and "left out" not in line]
    lines = lines if status == 0 else [*lines, said.getvalue().strip().splitlines()[-1]]
    return lines, f"{100 * (focal / camera.coefficients[0] - 1):+.2f} %"


def _lens(rng: np.random.Generator) -> Camera:
    width, height = SIZES[rng.integers(len(SIZES))]
    cx, cy = 0.5 * width + rng.uniform(-8, 8), 0.5 * height + rng.uniform(-8, 8)
    if rng.random() < 0.3:
        focal = width * rng.uniform(0.4, 0.55)
        return Fisheye(width, height, focal, 1.001 * focal, cx, cy, (rng.uniform(-0.03, 0.03), -0.01, 0.003, -0.0005))
    focal = width * rng.uniform(0.6, 1.1)
    distortion = (rng.uniform(-0.25, 0.05), rng.uniform(0.0, 0.08), 1e-4, -2e-4, 0.0)
    return Pinhole(width, height, focal, 0.999 * focal, cx, cy, distortion)
