"""Placed from nowhere in bare geometry: a town by day, by night, by other cameras.

A drive begins anywhere in 100 x 100 m; parked cars and traffic are in the images, not in the cloud.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.bare import trials
from benchmarks.bare.drives import LENSES, LIGHTS, NIGHT, Studio, kidnapped
from benchmarks.bare.trials import Trial, run_filter
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import LightParams

HELP = "places from nowhere: town by day, night and other cameras"
HEAD = ("case", "starts", "found %", "wrong", "error m", "deg", "found by image", "first image ms", "TRACKING ms")


@dataclass(frozen=True)
class Case:
    """Starts in the town: camera, lights, images of a drive, starts quick and full, share that is to be found in %."""

    camera: str
    lights: tuple[LightParams, ...]
    num_images: int
    counts: tuple[int, int]
    least: float


CASES = {
    "town": Case("panorama", LIGHTS, 20, (4, 100), 95.0),
    "town by night": Case("panorama", (NIGHT,), 20, (0, 24), 95.0),
    "pinhole of 100 deg": Case("pinhole_100", LIGHTS[:1], 40, (0, 15), 80.0),
    "fisheye of 190 deg": Case("fisheye_190", LIGHTS[:1], 40, (0, 15), 80.0),
    "fisheye to the sky": Case("fisheye_190_up", LIGHTS[:1], 40, (0, 15), 80.0),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    trials.add_arguments(parser)


def run(options: argparse.Namespace) -> Report:
    """Start everywhere."""
    report, rows, is_quick = Report("starts", notes=[__doc__ or ""]), list[tuple[str, ...]](), options.size == "quick"
    here, plan = trials.town(options.seed, options.likeness)
    studio = Studio("town", options.seed)
    for name, case in CASES.items():
        if count := case.counts[not is_quick]:
            drives = kidnapped(studio, plan, count, case.num_images, LENSES[case.camera], case.lights)
            found = [run_filter(here, drive, seed) for seed, drive in enumerate(drives)]
            rows.append((name, *_figures(found)))
            report.bounds += _start_bounds(name, found, case.least)
    report.tables.append(Table("Starts", HEAD, rows))
    return report


def _start_bounds(name: str, found: Sequence[Trial], least: float) -> list[Bound]:
    share, wrong = 100.0 * np.mean([one.has_converged for one in found]), sum(one.num_false > 0 for one in found)
    told = Headline("bare geometry", "towns of the simulator, 100 m") if name == "town" else None
    what = f"{name}, {len(found)} starts"
    return [
        Bound(f"{what}: right and TRACKING at the last image", least, float(share), "%", True, told),
        Bound(f"{what}: TRACKING anywhere at a wrong place", 0.0, wrong, ""),
    ]


def _figures(found: Sequence[Trial]) -> tuple[str, ...]:
    good = [one for one in found if one.has_converged]
    middle = [np.median(ends) for ends in np.array([(one.meters[-1], one.degrees[-1]) for one in good]).T]
    first = f"{np.median([one.first for one in good]):.0f}" if good else "-"
    steady = np.concatenate([one.milliseconds[one.is_tracking] for one in found])
    return (
        str(len(found)),
        f"{100 * len(good) / len(found):.0f}",
        str(sum(one.num_false > 0 for one in found)),
        *([f"{value:.2f}" for value in middle] or ("-", "-")),
        first,
        f"{np.median([one.milliseconds[0] for one in found]):.0f}",
        f"{np.median(steady):.0f}" if len(steady) else "-",
    )
