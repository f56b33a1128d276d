"""`sphere_nav calibrate`: images of a board to rig.yaml, with a report."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from rig_calibration.boards.board import Board, parse_size, read_boards
from rig_calibration.boards.report import calibration_as_mapping, draw_calibration
from rig_calibration.calibrate import CameraSpec, calibrate
from sphere_nav.geometry.cameras.lens import MODELS
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav_tools.offline.board_images import check_board_sizes, detect_boards, find_images
from sphere_nav_tools.offline.settings import add, add_output, choose
from sphere_nav_tools.offline.tables import write_json

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
