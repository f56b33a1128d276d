"""A vehicle that learns by itself: a recorded room whose light leaves the map step by step, day after day.

A map of the first light, localised in with `learn`. Each day shows more of another light: a drive is localised with
`learn`, `map-learn` makes a new version of the map where that drive was tracked badly, and a third drive of that light
is localised before and after.
"""

from __future__ import annotations

import argparse
import shutil

from benchmarks.commands import call
from benchmarks.light.relight import TITLE, Placed, Room, in_kitchen
from benchmarks.report import Bound, Headline, Report, Table

SHARES = {"quick": (0.6,), "full": (0.3, 0.45, 0.6, 0.8, 1.0)}  # of the other light, one a day
MAX_WORSE = 1.05  # of the first light's median error, from version to version
LEARN = ("--set", "learn=true")


def run(options: argparse.Namespace) -> Report:
    """Measure day after day."""
    report = Report("learning", notes=[__doc__ or ""])
    return in_kitchen(options, report, lambda room: follow(room, options.seed, SHARES[options.size], report))


def follow(room: Room, seed: int, shares: tuple[float, ...], report: Report) -> None:
    """Drive day after day."""
    room.base()
    folder = room.folder
    shutil.copytree(folder / "map_day", folder / "map_learned")
    room.localize("map_learned", "day_2", *LEARN)  # by which later versions are judged
    first, rows, days = room.localize("map_learned", "day_2"), list[tuple[str, ...]](), list[tuple[Placed, ...]]()
    for share in shares:
        name = f"season{round(100 * share)}"
        room.drives(name, room.light("season", share, seed))
        before = room.localize("map_learned", f"{name}_2")
        room.localize("map_learned", f"{name}_1", *LEARN)
        try:
            said = call("map-learn", folder / "map_learned")
        except ValueError as error:
            said = str(error)
        after, now = room.localize("map_learned", f"{name}_2"), room.localize("map_learned", "day_2")
        told = said.strip().splitlines()[0].replace(f"{folder}/", "")
        rows.append((f"season {share:.0%}", str(before), told, str(after), str(now)))
        days.append((before, after, first, now))
        first = now
    columns = ("light", "before", "learned", "after", "first light after")
    report.tables.append(Table(TITLE, columns, rows))
    report.bounds += judge(days)


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
