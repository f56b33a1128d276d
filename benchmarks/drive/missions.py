"""Missions over a network of 1.1 km in the simulated city: `route_navigator` and `path_follower` on a bus, with a car.

Five drives through the city make the network: around its blocks, by two streets in its middle, one of them both ways,
and from the south. Missions go from one of six places to another, drawn at random; about every 150 m somebody steps
before the car and off again. The nodes, their messages and calls are the real ones; poses are the truth with noise, ten
a second and 50 ms late, so that this measures missions, ways and joints; by a camera, the localiser tells them. Of the
missions with an edge closed under way one half has it closed by the call, the other by something that stays on it, each
second time just behind the branch, so that it is seen from before; edges with another way around are preferred.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.drive.mission_cameras import CameraTown, City
from benchmarks.drive.mission_town import Driven, Town
from benchmarks.report import Bound, Headline, Report, Table

HELP = "missions over a network: arrived, contacts, lateral error, error at branches, stops at joints, closed edges"
FULL, QUICK, BY_CAMERA = (100, 20), (3, 2), (12, 4)  # missions, and those with an edge closed under way
COLUMNS = ("from", "to", "closed", "arrived", "m", "contacts", "lateral RMSE m", "at branches m", "stops at joints")


def run(options: argparse.Namespace) -> Report:
    """Drive all missions, one after the other, each from where the last one ended; by a camera, too, in full size."""
    logging.getLogger("sphere_nav").setLevel(logging.CRITICAL)
    report, is_quick = Report("missions", notes=[__doc__ or ""]), options.size == "quick"
    with tempfile.TemporaryDirectory() as name:
        drive_in(Town(Path(name), options.seed), "missions", QUICK if is_quick else FULL, report)
        if not is_quick:
            city = City(options.city_map or Path(name) / "city", options.seed, options.threads)
            town = CameraTown(Path(name), city, options.seed)
            drive_in(town, "missions by a camera", BY_CAMERA, report)
            report.notes.append(town.told)
    return report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where the map of a city is kept, which takes an hour to make."""
    parser.add_argument("--city-map", type=Path, metavar="DIR", help="map of the city of an earlier run of this seed")


def drive_in(town: Town, what: str, counts: tuple[int, int], report: Report) -> None:
    """Drive so many missions, and so many with an edge closed under way; add the bounds."""
    count, closed = counts
    closings = [*[""] * count, *[("call", "obstacle")[number % 2] for number in range(closed)]]
    every = list(drive_all(town, closings))
    driven, shut = every[:count], every[count:]
    title = f"{what} over {town.length:.0f} m, {len(town.network.edges)} edges"
    report.tables.append(Table(title, COLUMNS, [cells(one) for one in every]))
    named = sum(one.is_arrived or "no way" in one.reason for one in shut)
    of = Headline("drives and missions", f"{sum(counts)} {what} in a city of 1.1 km")
    arrived, contacts = sum(one.is_arrived for one in driven), sum(one.contacts for one in every)
    report.bounds += [
        Bound(f"{what}: arrived, of {count}", count, arrived, "", True, of),
        Bound(f"{what}: contacts", 0, contacts, "", headline=of),
        Bound(f"{what}: lateral RMSE", 0.03, rmse([e for one in driven for e in one.lateral]), "m", headline=of),
        Bound(f"{what}: lateral RMSE at branches", 0.05, rmse([e for one in driven for e in one.at_branches]), "m"),
        Bound(f"{what}: stops at joints", 0, sum(one.stops for one in driven), ""),
        Bound(f"{what}: edge closed: another way or a named refusal, of {closed}", closed, named, "", True),
    ]


def drive_all(town: Town, closings: Sequence[str]) -> Iterator[Driven]:
    """Yield what becomes of each mission; say it at once, since all of them take hours by a camera."""
    print(" | ".join(COLUMNS), file=sys.stderr, flush=True)
    for closing in closings:
        driven = town.drive(closing)
        print(" | ".join(cells(driven)), file=sys.stderr, flush=True)
        yield driven


def cells(driven: Driven) -> tuple[str, ...]:
    """Return the row of a mission."""
    return (
        *(driven.start, driven.goal, driven.closed or "–", "yes" if driven.is_arrived else driven.reason),
        *(f"{driven.distance:.0f}", str(driven.contacts)),
        *(f"{rmse(driven.lateral):.3f}", f"{rmse(driven.at_branches):.3f}", str(driven.stops)),
    )


def rmse(errors: list[float]) -> float:
    """Return the root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0
