"""Missions over a network of 1.1 km in the simulated city: `route_navigator` and `path_follower` on a bus, with a car.

Five drives through the city make the network: around its blocks, by two streets in its middle, one of them both ways,
and from the south. Missions go from one of six places to another, drawn at random; about every 150 m somebody steps
before the car and off again. The nodes, their messages and calls are the real ones; poses are the truth with noise, ten
a second and 50 ms late, so that this measures missions, ways and joints, not localisation. Of the missions with an edge
closed under way one half has it closed by the call, the other by something that stays on it, each second time just
behind the branch, so that it is seen from before; edges with another way around are preferred. Seeds 1 to 20 were
looked at while this was written; figures are of seed 101 on.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.machine import describe
from benchmarks.mission_cameras import QUICK_TOUR, TOUR, CameraTown, City
from benchmarks.mission_town import Driven, Town
from benchmarks.report import Bound, Report, Table

HELP = "missions over a network: arrived, contacts, lateral error, error at branches, stops at joints, closed edges"
MISSIONS, CLOSED = 100, 20
COLUMNS = ("from", "to", "closed", "arrived", "m", "contacts", "lateral RMSE m", "at branches m", "stops at joints")


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--missions", type=int, help=f"random missions ({MISSIONS})")
    parser.add_argument("--closed", type=int, help=f"missions with an edge closed under way ({CLOSED})")
    parser.add_argument("--mission-seed", type=int, default=101, help="of drives, missions and walkers (101)")
    told = "localized by a camera, in the map of the city in this folder, made there where it is not (an hour)"
    parser.add_argument("--city-map", type=Path, metavar="DIR", help=told)
    parser.add_argument("--city-seed", type=int, default=101, help="of the city of --city-map (101)")


def run(options: argparse.Namespace) -> Report:
    """Drive all missions, one after the other, each from where the last one ended."""
    count, closed = (8, 4) if options.quick else (MISSIONS, CLOSED)
    count = count if options.missions is None else options.missions
    closed = closed if options.closed is None else options.closed
    logging.getLogger("sphere_nav").setLevel(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as folder:
        town = make_town(Path(folder), options)
        closings = [*[""] * count, *[("call", "obstacle")[number % 2] for number in range(closed)]]
        every = list(drive_all(town, closings))
    driven, shut = every[:count], every[count:]
    report = Report("missions", notes=[describe(options.threads), __doc__ or ""])
    rows = [cells(d) for d in every]
    report.tables.append(Table(f"missions over {town.length:.0f} m, {len(town.network.edges)} edges", COLUMNS, rows))
    what = "missions" if options.city_map is None else "missions by a camera"
    named = sum(d.is_arrived or "no way" in d.reason for d in shut)
    report.bounds += [
        Bound(f"{what}: arrived, of {count}", count, sum(d.is_arrived for d in driven), "", is_minimum=True),
        Bound(f"{what}: contacts", 0, sum(d.contacts for d in every), ""),
        Bound(f"{what}: lateral RMSE", 0.03, rmse([e for d in driven for e in d.lateral]), "m"),
        Bound(f"{what}: lateral RMSE at branches", 0.05, rmse([e for d in driven for e in d.at_branches]), "m"),
        Bound(f"{what}: stops at joints", 0, sum(d.stops for d in driven), ""),
        Bound(f"{what}: edge closed: another way or a named refusal, of {closed}", closed, named, "", is_minimum=True),
    ]
    if options.city_map is not None:
        report.notes.append(town.told)
    return report


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


def make_town(folder: Path, options: argparse.Namespace) -> Town:
    """Return the network with poses that are the truth with noise, or those of the localizer."""
    if options.city_map is None:
        return Town(folder, options.mission_seed)
    city = City(options.city_map, options.city_seed, QUICK_TOUR if options.quick else TOUR, options.threads)
    return CameraTown(folder, city, options.mission_seed)


def rmse(errors: list[float]) -> float:
    """Return the root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0
