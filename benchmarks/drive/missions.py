"""Missions over a network of 1.1 km in the simulated city: `route_navigator` and `path_follower` on a bus, with a car.

One tour through the city makes the network: around its blocks, by two streets in its middle, one of them both ways, and
over a square. Missions go from one of six places to another, drawn at random; about every 150 m somebody steps before
the car and off again. The nodes, their messages and calls are the real ones; poses are the truth with noise, ten a
second and 50 ms late, so that this measures missions, ways and joints; by a camera, the localiser tells them.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.drive.mission_cameras import CameraTown, City
from benchmarks.drive.mission_town import Driven, Town
from benchmarks.report import Bound, Headline, Report, Table

FULL, QUICK, BY_CAMERA = 100, 3, 12  # missions
COLUMNS = ("from", "to", "arrived", "m", "contacts", "lateral RMSE m", "stops at joints")


def run(options: argparse.Namespace) -> Report:
    """Drive all missions, one after the other, each from where the last one ended; by a camera, too, in full size."""
    logging.getLogger("sphere_nav").setLevel(logging.CRITICAL)
    report, is_quick = Report("missions", notes=[__doc__ or ""]), options.size == "quick"
    with tempfile.TemporaryDirectory() as name:
        drive_in(Town(Path(name), options.seed), "missions", QUICK if is_quick else FULL, report)
        if not is_quick:
            city = City(Path(name) / "city", options.seed, options.threads)
            town = CameraTown(Path(name), city, options.seed)
            drive_in(town, "missions by a camera", BY_CAMERA, report)
            report.notes.append(town.told)
    return report


def drive_in(town: Town, what: str, count: int, report: Report) -> None:
    """Drive so many missions; add the bounds."""
    driven = list(drive_all(town, count))
    title = f"{what} over {town.length:.0f} m, {len(town.network.edges)} edges"
    report.tables.append(Table(title, COLUMNS, [cells(one) for one in driven]))
    of, arrived = Headline("drives and missions", f"{count} {what} in a city"), sum(one.is_arrived for one in driven)
    report.bounds += [
        Bound(f"{what}: arrived", count, arrived, f"of {count}", True, of),
        Bound(f"{what}: contacts", 0, sum(one.contacts for one in driven), "", headline=of),
        Bound(f"{what}: lateral RMSE", 0.03, rmse([e for one in driven for e in one.lateral]), "m"),
        Bound(f"{what}: stops at joints", 0, sum(one.stops for one in driven), ""),
    ]


def drive_all(town: Town, count: int) -> Iterator[Driven]:
    """Yield what becomes of each mission; say it at once, since all of them take hours by a camera."""
    print(" | ".join(COLUMNS), file=sys.stderr, flush=True)
    for _ in range(count):
        driven = town.drive()
        print(" | ".join(cells(driven)), file=sys.stderr, flush=True)
        yield driven


def cells(driven: Driven) -> tuple[str, ...]:
    """Return the row of a mission."""
    arrived = "yes" if driven.is_arrived else driven.reason
    numbers = f"{driven.distance:.0f}", str(driven.contacts), f"{rmse(driven.lateral):.3f}", str(driven.stops)
    return driven.start, driven.goal, arrived, *numbers


def rmse(errors: list[float]) -> float:
    """Return the root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0
