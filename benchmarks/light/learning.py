"""A vehicle that learns by itself: a recorded room whose light leaves the map step by step, day after day.

A map of the first light, localised in with `learn`. Each day shows more of another light: a drive is localised with
`learn`, `map-learn` makes a new version of the map where that drive was tracked badly, and a third drive of that light
is localised before and after. At the end `map-learn` is killed at random moments: the map must be the old or the new
one, whole.
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

from benchmarks.commands import call
from benchmarks.light.relight import Placed, Room
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rgbd_data import Recording
from sphere_nav.ros.maps.check import verify_map
from sphere_nav.ros.maps.reader import FILE_NAME, open_map

HELP = "a vehicle that learns by itself: light that leaves the map step by step; map-learn killed"
SHARES, QUICK_SHARES = (0.3, 0.45, 0.6, 0.8, 1.0), (0.6,)  # of the other light, one a day
MAX_WORSE = 1.05  # of the first light's median error, from version to version
KILLS, QUICK_KILLS = 20, 2
PATIENCE_S = 300.0
LEARN = ("--set", "learn=true")


def run(options: argparse.Namespace) -> Report:
    """Measure day after day."""
    recording, is_quick = Recording.open(options.data), options.size == "quick"
    if recording is None:
        return Report("learning", skipped=f"no redkitchen with COLMAP's poses in {options.data}")
    report = Report("learning", notes=[__doc__ or ""])
    with tempfile.TemporaryDirectory() as temporary:
        room = Room(recording, Path(temporary), 60 if is_quick else 120)
        moment = follow(room, options.seed, QUICK_SHARES if is_quick else SHARES, report)
        report.bounds.append(Bound("something was learned from a drive tracked badly", 1, moment is not None, "", True))
        if moment is not None:
            rng = np.random.default_rng(options.seed)
            end_runs(moment, rng, QUICK_KILLS if is_quick else KILLS, report)
    return report


def follow(room: Room, seed: int, shares: tuple[float, ...], report: Report) -> Path | None:
    """Drive day after day; return a copy of a map as it was before it learned."""
    room.base()
    folder, moment = room.folder, None
    shutil.copytree(folder / "map_day", folder / "map_learned")
    room.localize("map_learned", "day_2", *LEARN)  # by which later versions are judged
    first, rows, days = room.localize("map_learned", "day_2"), list[tuple[str, ...]](), list[tuple[Placed, ...]]()
    for share in shares:
        name = f"season{round(100 * share)}"
        room.drives(name, room.light("season", share, seed))
        before = room.localize("map_learned", f"{name}_2")
        room.localize("map_learned", f"{name}_1", *LEARN)
        for source in ("map_learned", "map_learned.drives"):
            shutil.copytree(folder / source, folder / "before" / source)
        try:
            said = call("map-learn", folder / "map_learned")
            moment = moment or (folder / "before").rename(folder / "moment")
        except ValueError as error:
            said = str(error)
        shutil.rmtree(folder / "before", ignore_errors=True)
        after, now = room.localize("map_learned", f"{name}_2"), room.localize("map_learned", "day_2")
        told = said.strip().splitlines()[0].replace(f"{folder}/", "")
        rows.append((f"season {share:.0%}", str(before), told, str(after), str(now)))
        days.append((before, after, first, now))
        first = now
    columns = ("light", "before", "learned", "after", "first light after")
    report.tables.append(Table("Images placed, wrong ones, median error", columns, rows))
    report.bounds += judge(days)
    return moment


def judge(days: list[tuple[Placed, ...]]) -> list[Bound]:
    """Return the bounds over all days: before and after learning, the first light before and after."""
    placed = [100.0 * after.placed / after.num_images for _, after, _, _ in days]
    of = Headline("other light", f"redkitchen, {len(days)} days of learning by itself")
    return [
        Bound("placed after learning, worst day", 99.0, min(placed), "%", True, of),
        Bound("images lost by learning", 0, sum(max(0, a.placed - b.placed) for a, b, _, _ in days), ""),
        Bound("wrong", 0, sum(after.num_wrong + now.num_wrong for _, after, _, now in days), ""),
        Bound("images of the first light lost", 0, sum(max(0, a.placed - b.placed) for _, _, a, b in days), ""),
        Bound("its median error over that before", MAX_WORSE, max(b.median_mm / a.median_mm for *_, a, b in days), ""),
    ]


# --- ended at random moments
@dataclass
class Ends:
    """What became of maps that were learning when they were ended."""

    num_ended: int = 0
    num_whole: int = 0  # the old map's bytes, or a map that knows the drive, without a problem
    num_again: int = 0  # of which the next run learned


def end_runs(moment: Path, rng: np.random.Generator, count: int, report: Report) -> None:
    """Kill `map-learn` after random times."""
    killed, whole = Ends(), Ends()
    with tempfile.TemporaryDirectory() as temporary:
        begun = time.monotonic()
        learn_until(moment, Path(temporary) / "whole", PATIENCE_S, whole)
        seconds = time.monotonic() - begun
        for number in range(count):
            learn_until(moment, Path(temporary) / f"kill_{number}", rng.uniform(0.0, 0.9 * seconds), killed)
    report.notes.append(f"killed: {killed.num_ended} of {count} runs ended before they had learned")
    report.bounds += [
        Bound("left alone: runs that learned", 1, 1 - whole.num_ended, "", True),
        Bound("killed: maps that are whole, the old or the new one", count, killed.num_whole, "", True),
        Bound("killed: learned then, or by the next run", count, killed.num_again, "", True),
    ]


def learn_until(moment: Path, folder: Path, after_s: float, ends: Ends) -> None:
    """Learn in a copy of a map, up to some time; look what is there, and learn again."""
    shutil.copytree(moment, folder)
    path, old = folder / "map_learned", (moment / "map_learned" / FILE_NAME).read_bytes()
    ends.num_ended += _learn(folder, after_s) != 0
    is_old = (path / FILE_NAME).read_bytes() == old
    ends.num_whole += not verify_map(path) and (is_old or _knows_more(path, moment / "map_learned"))
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
