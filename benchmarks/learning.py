"""A vehicle that learns by itself: a recorded room whose light leaves the map step by step, day after day.

A map of the first light, localised in with `learn`. Each day shows more of another light: a drive is localised with
`learn`, `map-learn` makes a new version of the map where that drive was tracked badly, and a third drive of that light
is localised before and after. Nothing but the camera's grey levels is used of the later drives. At the end `map-learn`
is killed at random moments, and run on disks that are full at random moments: the map must be the old or the new one,
whole. Parameters were chosen by the lights and images of `dev` (see relight).
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.machine import describe
from benchmarks.nothing_lost import PATIENCE_S, SLACK_BYTES
from benchmarks.relight import FRAMES, LIGHTS, WRONG, Placed, Room, call
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import colmap_poses
from sphere_nav.ros.maps.check import verify_map
from sphere_nav.ros.maps.reader import FILE_NAME, open_map

HELP = "a vehicle that learns by itself: light that leaves the map step by step; map-learn killed, on full disks"
SHARES = (0.3, 0.45, 0.6, 0.8, 1.0)  # of the other light, one a day
SEEDS = {"dev": 2, "report": 12}
DAY_MAX_WORSE = 1.05  # of the first light's median error, from version to version
SEED = 1  # of the moments


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; --room, --lights and --keep are those of relight."""
    parser.add_argument("--learn-kills", type=int, default=20, metavar="N", help="map-learn killed so often (20)")
    parser.add_argument("--learn-full", type=int, default=10, metavar="N", help="on so many full disks (10)")


def run(options: argparse.Namespace) -> Report:
    """Measure day after day."""
    poses = colmap_poses(options.room)
    if poses is None or not options.room.is_dir():
        return Report("learning", skipped=f"no {options.room} with COLMAP's poses beside it")
    kind = LIGHTS[options.lights][-1][0]
    report = Report("learning", notes=[describe(options.threads), f"lights: {options.lights}, {kind}"])
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        room = Room(options.room, poses, FRAMES[options.lights], folder)
        rows, moment = follow(room, folder, kind, SEEDS[options.lights], report, quick=options.quick)
        report.bounds.append(Bound("something was learned from a drive tracked badly", 1, moment is not None, "", True))
        columns = ("light", "before", "learned", "after", "first light after")
        report.tables.append(Table("Images placed, wrong ones, median error", columns, rows))
        if moment is not None:
            kill(moment, 3 if options.quick else options.learn_kills, report)
            fill(moment, 2 if options.quick else options.learn_full, report)
    return report


def follow(
    room: Room, folder: Path, kind: str, seed: int, report: Report, *, quick: bool
) -> tuple[list[tuple[str, ...]], Path | None]:
    """Drive day after day; return the rows, and a copy of a map as it was before it learned."""
    room.base()
    shutil.rmtree(folder / "map_learned", ignore_errors=True)
    shutil.copytree(folder / "map_day", folder / "map_learned")
    for left in ("map_learned.drives", "map_learned.previous", "moment"):
        shutil.rmtree(folder / left, ignore_errors=True)
    room.localize("map_learned", "day_2", "--set", "learn=true")  # by which later versions are judged
    day, rows, moment = room.localize("map_learned", "day_2"), list[tuple[str, ...]](), None
    first = day
    for share in SHARES[1:3] if quick else SHARES:
        name = f"{kind}{round(100 * share)}_{seed}"
        light = room.light(kind, share, seed)
        for number in (1, 2):
            room.drive(name, light, number)
        before = room.localize("map_learned", f"{name}_2")
        room.localize("map_learned", f"{name}_1", "--set", "learn=true")
        for source in ("map_learned", "map_learned.drives"):
            shutil.copytree(folder / source, folder / "before" / source)
        status, said = call("map-learn", folder / "map_learned")
        after, now = room.localize("map_learned", f"{name}_2"), room.localize("map_learned", "day_2")
        if status == 0 and moment is None:
            moment = (folder / "before").rename(folder / "moment")
        shutil.rmtree(folder / "before", ignore_errors=True)
        what = f"{kind} {share:.0%}, seed {seed}"
        told = said.strip().splitlines()[0].replace(f"{folder}/", "")
        rows.append((what, str(before), told, str(after), str(now)))
        report.bounds += _judge(what, before, after, first, now)
        first = now
    return rows, moment


def _judge(what: str, before: Placed, after: Placed, first: Placed, now: Placed) -> list[Bound]:
    return [
        Bound(f"{what}: images placed, at least as before", before.placed, after.placed, "", True),
        Bound(f"{what}: off by more than {WRONG[0]:g} m or {WRONG[1]:g} deg", 0, after.num_wrong + now.num_wrong, ""),
        Bound(f"{what}: the first light placed", first.placed, now.placed, "", True),
        Bound(f"{what}: its median error", DAY_MAX_WORSE * first.median_mm + 0.05, now.median_mm, "mm"),
    ]


@dataclass
class Ends:
    """What became of maps that were learning when they were ended."""

    num_ended: int = 0
    num_whole: int = 0  # the old map's bytes, or a map that knows the drive, without a problem
    num_again: int = 0  # of which the next run learned
    num_runs: int = 0


def kill(moment: Path, count: int, report: Report) -> None:
    """Kill `map-learn` after random times."""
    rng, ends, whole = np.random.default_rng(SEED), Ends(), Ends()
    with tempfile.TemporaryDirectory() as temporary:
        begun = time.monotonic()
        _end(moment, Path(temporary) / "whole", PATIENCE_S, whole)
        seconds = time.monotonic() - begun
        for number in range(count):
            _end(moment, Path(temporary) / f"kill_{number}", rng.uniform(0.0, 0.9 * seconds), ends)
    report.bounds.append(Bound("left alone: runs that learned", 1, 1 - whole.num_ended, "", True))
    _report("killed", ends, report)


def fill(moment: Path, count: int, report: Report) -> None:
    """Learn on disks that take a part of what that needs."""
    rng, ends = np.random.default_rng(SEED), Ends()
    size = sum(file.stat().st_size for file in moment.rglob("*") if file.is_file())
    need = 2 * (moment / "map_learned" / FILE_NAME).stat().st_size
    with tempfile.TemporaryDirectory() as temporary:
        for number in range(count):
            folder = Path(temporary) / f"full_{number}"
            folder.mkdir()
            room = size + SLACK_BYTES + round(rng.uniform(0.0, 1.0) * need)
            mount = ["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(folder)]
            if subprocess.run(mount, capture_output=True, check=False).returncode:
                report.notes.append("full disks: no tmpfs can be mounted here")
                return
            try:
                _end(moment, folder / "in", PATIENCE_S, ends, grow=folder)
            finally:
                subprocess.run(["umount", str(folder)], capture_output=True, check=False)
    _report("on a full disk", ends, report)


def _end(moment: Path, folder: Path, after_s: float, ends: Ends, grow: Path | None = None) -> None:
    """Learn in a copy of a map, up to some time; look what is there, and learn again."""
    shutil.copytree(moment, folder)
    old = (moment / "map_learned" / FILE_NAME).read_bytes()
    ends.num_runs += 1
    ends.num_ended += _learn(folder, after_s) != 0
    path = folder / "map_learned"
    is_old = (path / FILE_NAME).read_bytes() == old
    is_whole = not verify_map(path)
    ends.num_whole += is_whole and (is_old or _knows_more(path, moment / "map_learned"))
    if grow is not None:
        subprocess.run(["mount", "-o", "remount,size=1g", str(grow)], capture_output=True, check=True)
    ends.num_again += not is_old or _learn(folder) == 0


def _learn(folder: Path, after_s: float = PATIENCE_S) -> int:
    """Return the exit status of `map-learn` in a process of its own, killed after some time.

    It is not forked: this process has localised, and GNU OpenMP ends a child that uses it again.
    """
    command = [sys.executable, "-m", "sphere_nav_tools.cli.main", "map-learn", "map_learned"]
    with (folder / "said").open("ab") as said:
        process = subprocess.Popen(command, cwd=folder, stdout=said, stderr=said)
        try:
            return process.wait(after_s)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def _knows_more(path: Path, before: Path) -> bool:
    with open_map(path) as new, open_map(before) as old:
        return set(old.graph.nodes) < set(new.graph.nodes)


def _report(how: str, ends: Ends, report: Report) -> None:
    report.notes.append(f"{how}: {ends.num_ended} of {ends.num_runs} runs ended before they had learned")
    report.bounds += [
        Bound(f"{how}: maps that are whole, the old or the new one", ends.num_runs, ends.num_whole, "", True),
        Bound(f"{how}: learned then, or by the next run", ends.num_runs, ends.num_again, "", True),
    ]
