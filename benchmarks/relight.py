"""A recorded room in other light, made by its depth and poses: what one extension of the map is worth.

A map is made of every third image; another drive of the next ones is seen in another light and extends it; a third
drive in that light is localised in the map alone, in the extended one, and in a map of that light alone; and the first
light in the extended map. Parameters were chosen by the lights and images of `dev`.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from benchmarks.machine import describe
from benchmarks.other_light import Light
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import colmap_poses, open_recording
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav_tools.cli.main import main as sphere_nav
from sphere_nav_tools.offline.evaluation import evaluate_poses
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "a recorded room in other light: images placed before and after one extension of the map"
LIGHTS = {  # what, share of the other light, seed of its directions and patches
    "dev": (("lamp", 1.0, 1), ("season", 0.6, 2), ("season", 0.85, 2), ("season", 1.0, 2)),
    "report": (("lamp", 1.0, 11), ("season", 0.6, 12), ("season", 0.85, 12), ("season", 1.0, 12), ("season", 1.0, 13)),
}
FRAMES = {"dev": 120, "report": 0}  # the first one; drives are every third of 120 from there, and from the next two
LENGTH, STEP = 120, 3
MAX_WORSE = 1.5  # error by that of the map of that light alone
WRONG = 0.1, 5.0  # m, deg: a pose that is wrong


TITLE = "Images placed, wrong ones, median error"
COLUMNS = ("light", "map alone", "extension", "after it", "own map", "first light before", "first light after")


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--room", type=Path, default=Path("../shared/data/rgbd/redkitchen"), help="7-Scenes folder")
    parser.add_argument("--lights", choices=LIGHTS, default="report", help="dev: by which parameters were chosen")
    parser.add_argument("--light", type=int, nargs="*", help="numbers of the lights, from 0 (all)")
    parser.add_argument("--keep", type=Path, help="folder for bags and maps, that of an earlier run (none)")


def run(options: argparse.Namespace) -> Report:
    """Measure every light."""
    poses = colmap_poses(options.room)
    if poses is None or not options.room.is_dir():
        return Report("relight", skipped=f"no {options.room} with COLMAP's poses beside it")
    chosen = LIGHTS[options.lights][-1:] if options.quick else LIGHTS[options.lights]
    chosen = tuple(chosen[number] for number in options.light) if options.light else chosen
    report = Report("relight", notes=[describe(options.threads), f"lights: {options.lights}"])
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        room = Room(options.room, poses, FRAMES[options.lights], folder)
        own = room.base()
        rows = [room.measure(*light, own, report) for light in chosen]
    report.tables.append(Table(TITLE, COLUMNS, rows))
    return report


@dataclass(frozen=True)
class Placed:
    """What `localize` made of a drive."""

    num_images: int
    states: dict[str, int]
    num_wrong: int
    median_mm: float

    @property
    def placed(self) -> int:
        """Images with a pose: TRACKING and DEGRADED."""
        return self.states.get("TRACKING", 0) + self.states.get("DEGRADED", 0)

    def __str__(self) -> str:
        tracking = f"{self.placed} of {self.num_images} ({self.states.get('TRACKING', 0)} TRACKING)"
        return f"{tracking}, {self.num_wrong} wrong, {self.median_mm:.1f} mm"


class Drives(NamedTuple):
    """Names of bags: what extends the map, what is localised in the same light, and in the first one."""

    joined: str
    driven: str
    by_day: str


class Relit:
    """A recorded place in several lights, and what the commands make of it in a folder."""

    wrong = WRONG
    topics: tuple[str, ...] = ()  # words for `localize`, where they are not the usual ones

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def compare(self, light: tuple[str, float, int], drives: Drives, day: Placed, report: Report) -> tuple[str, ...]:
        """Localise before and after one extension, and in a map of the light alone; add the bounds, return the row."""
        kind, share, seed = light
        name = name_of(*light)
        alone = self.localize("map_day", drives.driven)
        self._map(drives.joined, f"map_{name}_own")
        own = self.localize(f"map_{name}_own", drives.driven)
        said = self._map(drives.joined, f"map_{name}", "--extend", self.folder / "map_day", "--experience", name)
        if "refused" in said:
            after, first = Placed(own.num_images, {}, 0, np.nan), day
        else:
            after, first = (self.localize(f"map_{name}", one) for one in (drives.driven, drives.by_day))
        what = f"{kind} {share:.0%}, seed {seed}"
        report.bounds += [
            Bound(f"{what}: images placed, at least as by its own map", own.placed, after.placed, "", True),
            Bound(f"{what}: wrong", 0, after.num_wrong + first.num_wrong, ""),
            Bound(f"{what}: median error", MAX_WORSE * own.median_mm, after.median_mm, "mm"),
            Bound(f"{what}: the first light placed", day.placed, first.placed, "", True),
            Bound(f"{what}: its median error", 1.05 * day.median_mm + 0.05, first.median_mm, "mm"),
        ]
        return what, str(alone), said, str(after), str(own), str(day), str(first)

    def _map(self, drive: str, name: str, *words: Any) -> str:
        """Make a map; return what was said of the joining, or why it was refused."""
        target = self.folder / name
        for remains in (target, target.with_name(f"{name}.partial")):
            shutil.rmtree(remains, ignore_errors=True)
        anchor = () if words else ("--anchor", "truth")
        status, said = call("map", self.folder / drive, "-o", target, *anchor, *words)
        lines = said.replace(f"{self.folder}/", "").strip().splitlines()
        if status:
            return f"refused: {lines[-1]}"
        return next((line for line in lines if line.startswith("joined")), "")

    def localize(self, name: str, drive: str, *words: str) -> Placed:
        """Localise a drive, judged by its truth; more words for the command."""
        poses, summary = self.folder / "poses.tum", self.folder / "summary.json"
        given = "localize", self.folder / name, self.folder / drive, "-o", poses, "--json", summary, "--overwrite"
        call(*given, *self.topics, *words)
        found = json.loads(summary.read_text(encoding="utf-8"))
        if not found["poses"]:
            return Placed(found["images"], found["states"], 0, np.nan)
        errors = evaluate_poses(read_tum(poses), read_poses(self.folder / drive, ("ground_truth/pose",))).errors
        is_wrong = (errors.translation_m > self.wrong[0]) | (np.degrees(errors.rotation_rad) > self.wrong[1])
        median = 1e3 * float(np.median(errors.translation_m))
        return Placed(found["images"], found["states"], int(is_wrong.sum()), median)


class Room(Relit):
    """A recording of a room in several lights."""

    def __init__(self, data: Path, poses: Path, first: int, folder: Path) -> None:
        super().__init__(folder)
        self._data, self._poses, self._first = data, poses, first
        self.recording = open_recording(data, poses)
        self.calibration = self.recording.calibrations[-1]

    def base(self) -> Placed:
        """Map the first drive in its own light, localise the third one in it."""
        for number in (0, 2):
            self.drive("day", None, number)
        if not (self.folder / "map_day").exists():
            self._map("day_0", "map_day")
        return self.localize("map_day", "day_2")

    def measure(self, kind: str, share: float, seed: int, day: Placed, report: Report) -> tuple[str, ...]:
        """Measure one light; return its row."""
        name = name_of(kind, share, seed)
        light = self.light(kind, share, seed)
        for number in (1, 2):
            self.drive(name, light, number)
        return self.compare((kind, share, seed), Drives(f"{name}_1", f"{name}_2", "day_2"), day, report)

    def light(self, kind: str, share: float, seed: int, what: type[Light] = Light) -> Light:
        """Return another light of this room."""
        frames = [self.recording.frame(path, self.calibration) for path in self.pose_files(0)[::5]]
        return what(kind, share, seed, frames, self.calibration.camera)

    def pose_files(self, number: int) -> list[Path]:
        """Return the files of the true poses of a drive."""
        first = self._first + number
        last = self._first + LENGTH
        return [self._poses / f"frame-{index:06d}.pose.txt" for index in range(first, last, STEP)]

    def drive(self, name: str, light: Any, number: int) -> None:
        """Make a bag of a drive in a light."""
        bag, folder = self.folder / f"{name}_{number}", self.folder / f"{name}_{number}_images"
        if bag.exists():
            return
        folder.mkdir()
        for path in self.pose_files(number):
            stem = path.name.removesuffix(".pose.txt")
            frame = self.recording.frame(path, self.calibration)
            gray = frame.gray.astype(np.float32)
            gray = gray if light is None else light.shine(gray, frame.depth_m, frame.T_world_camera)
            cv2.imwrite(str(folder / f"{stem}.color.png"), np.clip(np.rint(gray), 1, 255).astype(np.uint8))
            for source in (self._data / f"{stem}.depth.png", path):
                shutil.copy(source, folder / source.name)
        status, said = call("import", "seven_scenes", folder, "-o", bag, "--truth-camera", "colour")
        if status:
            raise ValueError(f"{bag}: {said}")
        shutil.rmtree(folder)


def name_of(kind: str, share: float, seed: int) -> str:
    """Return the name of a light, of which bags and maps are named."""
    return f"{kind}{round(100 * share)}_{seed}"


def call(*words: Any) -> tuple[int, str]:
    """Run a command; return its exit code and what it printed, errors included."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = sphere_nav([str(word) for word in words])
    return status, said.getvalue()
