"""`sphere_nav calibrate`: images of a board to rig.yaml, with a report."""

from __future__ import annotations

import argparse
import glob
import json
import os
import re
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from rig_calibration.boards.board import Board, parse_size, read_boards
from rig_calibration.boards.detect import detect_all
from rig_calibration.boards.report import as_mapping, draw
from rig_calibration.boards.views import Array, Indices, View
from rig_calibration.calibrate import CameraSpec, calibrate
from rig_calibration.params import CalibrationParams
from sphere_nav.geometry.files.rig_file import write_rig

HELP = "lenses and poses of all cameras of a rig from images of boards"
EXAMPLES = """\
examples:
  sphere_nav calibrate recordings/cam0 recordings/cam1 --board 8x6 --square 0.03 -o rig.yaml
  sphere_nav calibrate 'left*.jpg' 'right*.jpg' --board 9x6 --square 0.025 -o rig.yaml
  sphere_nav calibrate recordings/* --boards boards.yaml --model fisheye -o rig.yaml

One folder, or one quoted glob, for each camera. Images of one instant have the same name, or the same number in it.
A board counts inner corners. report.json and report.png are written beside the rig file.
"""
MAX_THREADS = 8
SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("images", nargs="+", metavar="IMAGES", help="a folder or a glob for each camera")
    parser.add_argument("--board", metavar="8x6", help="inner corners of the board")
    parser.add_argument("--square", type=float, metavar="M", help="side of a square in m")
    parser.add_argument("--charuco", type=float, metavar="M", help="a ChArUco board with markers of this side in m")
    parser.add_argument("--dictionary", default="DICT_4X4_250", help="of the ChArUco markers (DICT_4X4_250)")
    parser.add_argument("--boards", type=Path, metavar="FILE", help="several boards, in YAML")
    parser.add_argument("--model", choices=("pinhole", "fisheye"), default="pinhole", help="of the lenses (pinhole)")
    parser.add_argument("-o", "--output", type=Path, required=True, help="rig file to write")
    parser.add_argument("--force", action="store_true", help="replace an existing rig file")


def run(arguments: argparse.Namespace) -> int:
    """Detect, calibrate, write rig and report."""
    boards = _boards(arguments)
    if arguments.output.exists() and not arguments.force:
        raise ValueError(f"{arguments.output}: expected no such file, found one (--force replaces it)")
    cameras = find_images(arguments.images)
    sizes, views = _detect(cameras, boards)
    specs = [CameraSpec(name, arguments.model, sizes[name]) for name in cameras]
    with tqdm(desc="calibrating", bar_format="{desc} {elapsed}", leave=False) as bar:
        found = calibrate(specs, boards, views, CalibrationParams(), progress=bar.set_description_str)
    write_rig(arguments.output, found.rig, is_overwriting=arguments.force)
    report, stem = as_mapping(found), arguments.output.with_suffix("")
    Path(f"{stem}_report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    draw(found, Path(f"{stem}_report.png"))
    for name, row in report["cameras"].items():
        held_out = row["held_out_rms_px"]
        print(f"{name}: RMS {row['rms_px']:.3f} px, held out {'-' if held_out is None else f'{held_out:.3f} px'}")
    unseen = [f"{board.name}: seen in no image" for board in boards if board.name not in {v.board for v in views}]
    for line in [f"left out {name}: {why}" for name, why in found.dropped.items()] + unseen + found.warnings:
        print(f"warning: {line}")
    return 0


def find_images(arguments: list[str]) -> dict[str, dict[str, Path]]:
    """Return the images of every camera by the instant that their names tell."""
    cameras: dict[str, list[Path]] = defaultdict(list)
    for text in arguments:
        path = Path(text)
        if path.is_dir():
            files = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
            name = path.resolve().name
        else:
            files = sorted(Path(item) for item in glob.glob(text))
            name = re.split(r"\d", files[0].stem)[0].strip("_-") or files[0].parent.name if files else ""
        if not files:
            raise ValueError(f"{text}: expected images, found none")
        cameras[re.sub(r"\W", "_", name)].extend(files)
    named = [{file.stem for file in files} for files in cameras.values()]
    is_by_name = len(named) == 1 or bool(set.intersection(*named))
    return {name: {_instant(file, is_by_name): file for file in files} for name, files in cameras.items()}


def _instant(file: Path, is_by_name: bool) -> str:
    numbers = re.findall(r"\d+", file.stem)
    if is_by_name:
        return file.stem
    if not numbers:
        raise ValueError(f"{file}: expected a number in the name, or names alike in all folders, found none")
    return str(int(numbers[-1]))


def _detect(
    cameras: dict[str, dict[str, Path]], boards: tuple[Board, ...]
) -> tuple[dict[str, tuple[int, int]], list[View]]:
    """Look for the boards in all images, in threads: OpenCV works outside of Python's lock."""
    work = [(name, instant, path) for name, files in cameras.items() for instant, path in files.items()]
    sizes: dict[str, tuple[int, int]] = {}
    views = []
    with ThreadPoolExecutor(min(len(os.sched_getaffinity(0)), MAX_THREADS)) as pool:
        found = pool.map(lambda item: _find_boards(item[2], boards), work)
        try:
            for item, answer in zip(
                work, tqdm(found, "looking for boards", len(work), False, unit="image"), strict=True
            ):
                (name, instant, path), (size, seen) = item, answer
                if sizes.setdefault(name, size) != size:
                    expected = "x".join(map(str, sizes[name]))
                    told = f"expected {expected} as other images of {name}, found {size[0]}x{size[1]}"
                    raise ValueError(f"{path}: {told}")
                views += [View(name, instant, board, *corners) for board, corners in seen.items()]
        finally:
            pool.shutdown(cancel_futures=True)
    return sizes, views


def _find_boards(path: Path, boards: tuple[Board, ...]) -> tuple[tuple[int, int], dict[str, tuple[Indices, Array]]]:
    """Return the size (width, height) of an image and the corners of the boards in it."""
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise ValueError(f"{path}: expected an image, found a file that cannot be read as one")
    return (grey.shape[1], grey.shape[0]), detect_all(np.asarray(grey), boards)


def _boards(arguments: argparse.Namespace) -> tuple[Board, ...]:
    if arguments.boards:
        return read_boards(arguments.boards)
    if not arguments.board or arguments.square is None:
        raise ValueError("expected --board and --square, or --boards")
    columns, rows = parse_size(arguments.board)
    kind = "chessboard" if arguments.charuco is None else "charuco"
    marker = arguments.charuco or 0.0
    return (Board("board", columns, rows, arguments.square, kind, marker, arguments.dictionary),)
