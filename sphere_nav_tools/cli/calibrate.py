"""`sphere_nav calibrate`: images of a board to rig.yaml, with a report.

Images in files or videos: those of one instant are found by their names, and the boards in all of them.
"""

from __future__ import annotations

import argparse
import glob
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rig_calibration.boards.board import Board, parse_size, read_boards
from rig_calibration.boards.detect import detect_all, edge_width, grid_sizes
from rig_calibration.boards.report import calibration_as_mapping, draw_calibration
from rig_calibration.boards.views import BoardView, Indices
from rig_calibration.calibrate import CameraSpec, calibrate
from sphere_nav.geometry.arrays import Array, Size
from sphere_nav.geometry.cameras.lens import MODELS
from sphere_nav.geometry.files.encoded import read_image_file
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav_tools.offline.importing.recording import VIDEOS, Video, is_image
from sphere_nav_tools.offline.settings import add, add_output, choose
from sphere_nav_tools.offline.tables import progress, write_json

Source: TypeAlias = Path | NDArray[Any]  # of a grey image: a file, or its levels
Cameras: TypeAlias = dict[str, dict[str, Source]]  # the images of each by the instant
NUM_SIZED = 4  # images of a camera whose boards are counted
NUM_OF_VIDEO = 80  # images that are taken of a video
HELP = """\
Lenses and poses of all cameras of a rig from images of boards.

examples:
  sphere_nav calibrate recordings/cam0 recordings/cam1 --board 8x6 --square 0.03 -o rig.yaml
  sphere_nav calibrate 'left*.jpg' 'right*.jpg' --board 9x6 --square 0.025 -o rig.yaml
  sphere_nav calibrate board.mp4 --board 8x6 --square 0.03 -o rig.yaml
  sphere_nav calibrate recordings/* --boards boards.yaml --model fisheye -o rig.yaml

One folder, one quoted glob, or one video for each camera. Images of one instant have the same name, or the same number
in it (videos: begun together). A board counts inner corners. rig_report.json and .png are written beside rig.yaml.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "images", "IMAGES", "a folder, a glob or a video for each camera", nargs="+")
    add(parser, "--board", "8x6", "inner corners of the board")
    add(parser, "--square", "M", "side of a square in m", float)
    add(parser, "--charuco", "M", "a ChArUco board with markers of this side in m", float)
    add(parser, "--dictionary", "DICTIONARY", "of the ChArUco markers (DICT_4X4_250)", default="DICT_4X4_250")
    add(parser, "--boards", "FILE", "several boards, in YAML", Path)
    choose(parser, "--model", MODELS, "of the lenses (pinhole)", "pinhole")
    add_output(parser, "FILE", "rig file to write")


def run(arguments: argparse.Namespace) -> None:
    """Detect, calibrate, write rig and report."""
    boards = _boards(arguments)
    cameras = find_images(arguments.images)
    sizes, views = detect_boards(cameras, boards)
    wrong_size = check_board_sizes(cameras, boards, views)
    if not views and wrong_size:
        raise ValueError(wrong_size[0])
    specs = [CameraSpec(name, arguments.model, sizes[name]) for name in cameras]
    with tqdm(desc="calibrating", bar_format="{desc} {elapsed}", leave=False) as bar:
        found = calibrate(specs, boards, views, progress=bar.set_description_str)
    write_rig(arguments.output, found.rig)
    report, stem = calibration_as_mapping(found), arguments.output.with_suffix("")
    write_json(f"{stem}_report.json", report)
    draw_calibration(found, Path(f"{stem}_report.png"))
    for name, row in report["cameras"].items():
        held_out = row["held_out_rms_px"]
        print(f"{name}: RMS {row['rms_px']:.3f} px, held out {'-' if held_out is None else f'{held_out:.3f} px'}")
    dropped = [f"left out {name}: {why}" for name, why in found.dropped.items()]
    unseen = {board.name for board in boards} - {view.board for view in views}
    for line in (*dropped, *(f"{name}: seen in no image" for name in sorted(unseen)), *wrong_size, *found.warnings):
        print(f"warning: {line}")


def _boards(arguments: argparse.Namespace) -> tuple[Board, ...]:
    if arguments.boards:
        return read_boards(arguments.boards)
    if not arguments.board or arguments.square is None:
        raise ValueError("expected --board and --square, or --boards")
    columns, rows = parse_size(arguments.board)
    kind = "chessboard" if arguments.charuco is None else "charuco"
    marker = arguments.charuco or 0.0
    return (Board("board", columns, rows, arguments.square, kind, marker, arguments.dictionary),)


def find_images(arguments: list[str]) -> Cameras:
    """Return the images of every camera by the instant that their names tell, or their numbers in a video."""
    cameras: dict[str, list[Path]] = defaultdict(list)
    videos: Cameras = {}
    for text in arguments:
        path = Path(text)
        if path.suffix.lower() in VIDEOS:
            videos[re.sub(r"\W", "_", path.stem)] = dict(read_video(path))
            continue
        if path.is_dir():
            files = sorted(filter(is_image, path.iterdir()))
            name = path.resolve().name
        else:
            files = sorted(Path(item) for item in glob.glob(text))
            name = re.split(r"\d", files[0].stem)[0].strip("_-") or files[0].parent.name if files else ""
        if not files:
            raise ValueError(f"{text}: expected images, found none")
        cameras[re.sub(r"\W", "_", name)].extend(files)
    named = [{file.stem for file in files} for files in cameras.values()]
    is_by_name = len(named) < 2 or bool(set.intersection(*named))
    return videos | {name: {_instant(file, is_by_name): file for file in files} for name, files in cameras.items()}


def read_video(path: Path) -> Iterator[tuple[str, Source]]:
    """Yield images spread over a video, by their number."""
    video = Video(path)
    chosen = np.unique(np.linspace(0, video.number - 1, min(NUM_OF_VIDEO, video.number)).round().astype(int))
    for index in progress(f"reading {path.name}", "image", chosen):
        yield f"{index:06d}", cv2.cvtColor(video.read(int(index)), cv2.COLOR_BGR2GRAY)


def _instant(file: Path, is_by_name: bool) -> str:
    numbers = re.findall(r"\d+", file.stem)
    if is_by_name:
        return file.stem
    if not numbers:
        raise ValueError(f"{file}: expected a number in the name, or names alike in all folders, found none")
    return str(int(numbers[-1]))


def detect_boards(cameras: Cameras, boards: tuple[Board, ...]) -> tuple[dict[str, Size], list[BoardView]]:
    """Look for the boards in all images, in threads: OpenCV works outside of Python's lock."""
    work = [(name, instant, path) for name, files in cameras.items() for instant, path in files.items()]
    sizes: dict[str, Size] = {}
    views = []
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        found = pool.map(lambda item: _find_boards(item[2], boards), work)
        try:
            for item, answer in zip(work, progress("looking for boards", "image", found, len(work)), strict=True):
                (name, instant, path), (size, seen) = item, answer
                if sizes.setdefault(name, size) != size:
                    expected = "x".join(map(str, sizes[name]))
                    told = f"expected {expected} as other images of {name}, found {size[0]}x{size[1]}"
                    raise ValueError(f"{path if isinstance(path, Path) else instant}: {told}")
                views += [BoardView(name, instant, board, *corners) for board, corners in seen.items()]
        finally:
            pool.shutdown(cancel_futures=True)
    return sizes, views


def check_board_sizes(cameras: Cameras, boards: tuple[Board, ...], views: list[BoardView]) -> list[str]:
    """Return a line where the chessboards in the images have another size than any that was given.

    A detector that is told fewer corners than a board has finds a part of it, another one in each image; one that is
    told more finds none.
    """
    if any(board.kind != "chessboard" for board in boards):
        return []
    found: Counter[Size] = Counter()
    given = {tuple(sorted((board.columns, board.rows))) for board in boards}
    seen = {(view.camera, view.instant) for view in views}
    for name, files in cameras.items():
        first = sorted(files, key=lambda instant: ((name, instant) not in seen, instant))[:NUM_SIZED]
        sizes = (size for instant in first for size in grid_sizes(_read_gray(files[instant]), len(boards)))
        found.update((max(size), min(size)) for size in sizes)
    count = sum(found.values())
    (columns, rows), most = found.most_common(1)[0] if found else ((0, 0), 0)
    if most < 2 or 2 * most < count or (rows, columns) in given:
        return []
    told = ", ".join(f"{board.columns}x{board.rows}" for board in boards)
    return [f"wrong board size: expected {told} inner corners, found grids of {columns}x{rows} in {most} of {count}"]


def _find_boards(source: Source, boards: tuple[Board, ...]) -> tuple[Size, dict[str, tuple[Indices, Array, float]]]:
    """Return the size (width, height) of an image and the corners of the boards in it, with their blur."""
    gray = _read_gray(source)
    by_name = {board.name: board for board in boards}
    found = detect_all(gray, boards)
    return (gray.shape[1], gray.shape[0]), {
        name: (*corners, edge_width(gray, by_name[name], *corners)) for name, corners in found.items()
    }


def _read_gray(source: Source) -> NDArray[Any]:
    return np.asarray(read_image_file(source, cv2.IMREAD_GRAYSCALE)) if isinstance(source, Path) else source
