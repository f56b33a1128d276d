"""A recorded room in other light, made by its depth and poses: what one extension is worth.

A map is made of some images; others, in another light, extend it; the rest in that light is localised in the map alone,
in the extended one, and in a map of that light alone; and the first light in the extended map. Lights follow from the
seed; parameters were chosen by other lights and other images of the room.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from benchmarks.commands import TRUTH, call
from benchmarks.light.lights import Light
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rgbd_data import Recording
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav_tools.offline.evaluation import evaluate_poses
from sphere_nav_tools.offline.pose_bags import read_poses

LIGHTS = (("season", 0.6), ("season", 0.85), ("season", 1.0), ("lamp", 1.0))  # what, share of the other light
NUM_FRAMES, STEP = {"quick": 60, "full": 120}, 3  # drives in the room are every third of them, and the next two of each
MAX_WORSE = 1.5  # error by that of the map of that light alone
WRONG = (0.1, 5.0)  # m, deg
OF_OWN = "of what its own map places"
TITLE = "Images placed, wrong ones, median error"
COLUMNS = ("light", "map alone", "extension", "after it", "own map", "first light before", "first light after")


@dataclass(frozen=True)
class Placed:
    """What `localize` made of a drive."""

    num_images: int
    placed: int  # with a pose: TRACKING and DEGRADED
    num_wrong: int
    median_mm: float

    def __str__(self) -> str:
        return f"{self.placed} of {self.num_images}, {self.num_wrong} wrong, {self.median_mm:.1f} mm"


class Result(NamedTuple):
    """One light: localised in the map alone, after its extension, in its own map; the first light before and after."""

    alone: Placed
    after: Placed
    own: Placed
    day: Placed
    day_after: Placed


class Room:
    """A recorded room in several lights, and what the commands make of it in a folder."""

    def __init__(self, recording: Recording, folder: Path, num_frames: int) -> None:
        self.folder = folder
        self._recording, self._num_frames = recording, num_frames

    def compare(self, kind: str, share: float, seed: int, day: Placed) -> tuple[Result, str]:
        """Localise before and after one extension, and in a map of the light alone; return what was said of it, too."""
        name = f"{kind}{round(100 * share)}"
        joined, driven = self.drives(name, self.light(kind, share, seed))
        alone = self.localize("map_day", driven)
        self.map(joined, f"map_{name}_own")
        own = self.localize(f"map_{name}_own", driven)
        try:
            said = self.map(joined, f"map_{name}", "--extend", self.folder / "map_day", "--experience", name)
        except ValueError:
            return Result(alone, Placed(own.num_images, 0, 0, np.nan), own, day, day), "refused"
        after, first = (self.localize(f"map_{name}", one) for one in (driven, "day_2"))
        told = next((line for line in said.splitlines() if line.startswith("joined")), "")
        return Result(alone, after, own, day, first), told

    def map(self, drive: str, name: str, *words: Any) -> str:
        """Make a map; return what was said."""
        return call("map", self.folder / drive, "-o", self.folder / name, *(words or ("--anchor", "truth")))

    def localize(self, name: str, drive: str, *words: str) -> Placed:
        """Localise a drive, judged by its truth; more words for the command."""
        poses, summary = self.folder / "poses.tum", self.folder / "summary.json"
        given = "localize", self.folder / name, self.folder / drive, "-o", poses, "--json", summary, "--overwrite"
        with suppress(ValueError):  # no image was placed, which the summary says
            call(*given, *words)
        found = json.loads(summary.read_text(encoding="utf-8"))
        placed = sum(found["states"].get(state, 0) for state in ("TRACKING", "DEGRADED"))
        if not found["poses"]:
            return Placed(found["images"], placed, 0, np.nan)
        errors = evaluate_poses(read_tum(poses), read_poses(self.folder / drive, TRUTH)).errors
        is_wrong = (errors.translation_m > WRONG[0]) | (np.degrees(errors.rotation_rad) > WRONG[1])
        return Placed(found["images"], placed, int(is_wrong.sum()), 1e3 * float(np.median(errors.translation_m)))

    def base(self) -> Placed:
        """Map the first drive in its own light, localise the third one in it."""
        for number in (0, 2):
            self.drive("day", None, number)
        self.map("day_0", "map_day")
        return self.localize("map_day", "day_2")

    def drives(self, name: str, light: Light) -> tuple[str, str]:
        """Make the bags of the second and of the third drive; return their names."""
        return self.drive(name, light, 1), self.drive(name, light, 2)

    def light(self, kind: str, share: float, seed: int, what: type[Light] = Light) -> Light:
        """Return another light of this room."""
        frames = [self._recording.frame(path) for path in self._paths(0)[::5]]
        return what(kind, share, seed, frames)

    def _paths(self, number: int) -> list[Path]:
        return [self._recording.poses / f"frame-{i:06d}.pose.txt" for i in range(number, self._num_frames, STEP)]

    def drive(self, name: str, light: Any, number: int) -> str:
        """Make a bag of a drive in a light; return its name."""
        bag, folder = self.folder / f"{name}_{number}", self.folder / f"{name}_{number}_images"
        folder.mkdir()
        for path in self._paths(number):
            frame = self._recording.frame(path)
            gray = frame.gray.astype(np.float32)
            gray = gray if light is None else light.shine(gray, frame.depth_m, frame.T_world_camera)
            cv2.imwrite(str(folder / f"{frame.name}.color.png"), np.clip(np.rint(gray), 1, 255).astype(np.uint8))
            for source in (self._recording.folder / f"{frame.name}.depth.png", path):
                shutil.copy(source, folder / source.name)
        call("import", "seven_scenes", folder, "-o", bag, "--truth-camera", "colour")
        return bag.name


def in_kitchen(options: argparse.Namespace, report: Report, measure: Callable[[Room], None]) -> Report:
    """Measure in the recorded room, in a part of it where the size is quick; return the report."""
    recording = Recording.open(options.data)
    if recording is None:
        return Report(report.name, skipped=f"no redkitchen with COLMAP's poses in {options.data}")
    with tempfile.TemporaryDirectory() as name:
        measure(Room(recording, Path(name), NUM_FRAMES[options.size]))
    return report


def run(options: argparse.Namespace) -> Report:
    """Measure every light."""
    report, found, rows = Report("relight", notes=[__doc__ or ""]), list[Result](), list[tuple[str, ...]]()

    def measure(room: Room) -> None:
        day = room.base()
        for seed, (kind, share) in enumerate(LIGHTS[:1] if options.size == "quick" else LIGHTS, options.seed):
            result, said = room.compare(kind, share, seed, day)
            found.append(result)
            alone, *others = map(str, result)
            rows.append((f"{kind} {share:.0%}, seed {seed}", alone, said, *others))
        report.tables.append(Table(TITLE, COLUMNS, rows))
        report.bounds += judge("redkitchen", found)

    return in_kitchen(options, report, measure)


def judge(what: str, found: list[Result]) -> list[Bound]:
    """Return the bounds over all lights of a place."""
    first = [100.0 * one.alone.placed / one.own.placed for one in found]
    after = [100.0 * one.after.placed / one.own.placed for one in found]
    worse = max(one.after.median_mm / one.own.median_mm for one in found)
    wrong = sum(part.num_wrong for one in found for part in (one.alone, one.after, one.day_after))
    lost = sum(max(0, one.day.placed - one.day_after.placed) for one in found)
    blur = max(one.day_after.median_mm / one.day.median_mm for one in found)
    of = Headline("other light", f"{what} in {len(found)} lights", "a map of that light alone: 100 %")
    return [
        Bound(f"{what}: placed on the first visit, {OF_OWN}", 90.0, float(np.mean(first)), "%", True, of),
        Bound(f"{what}: placed after one extension, all lights", 99.0, float(np.mean(after)), "%", True, of),
        Bound(f"{what}: placed after one extension, worst light", 99.0, min(after), "%", True, of),
        Bound(f"{what}: wrong, all drives", 0, wrong, ""),
        Bound(f"{what}: median error after it over that in the own map, worst", MAX_WORSE, worse, ""),
        Bound(f"{what}: images of the first light lost by it", 0, lost, ""),
        Bound(f"{what}: its median error over that before, worst", 1.1, blur, ""),
    ]
