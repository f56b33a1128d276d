"""The corridor of 160 m where every bay looks like the next (N17 section V): a place is named when it is proven."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import Drive
from benchmarks.mcl_sites import Settings
from benchmarks.mcl_trials import Trial, remembering, run_filter
from benchmarks.report import Bound, Report, Table
from cycab_sim.world.worlds import CORRIDOR
from mcl_depth.geometry.area import Area

HELP = "MCL in a corridor of equal bays: withheld while ambiguous, found at the end"
STEP = 2.0  # m
PRIOR = 40.0  # particles are spread over so much of the corridor at the start, as in N17, m
LAST = 156.0  # where the drives end, m
OFFSETS = (0.0, 0.35, -0.35)  # from the middle, m
SETTINGS: Settings = {"area.limits": f"0.3,-2.5,{CORRIDOR - 0.3:.1f},2.5"}


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--corridor-drives", type=int, default=6, help="drives from the first bay to the far end (6)")
    parser.add_argument("--control", action="store_true", help="the same drives with turned images, too")


def run(options: argparse.Namespace) -> Report:
    """Drive from the first bay to the far end, with each kind of likeness, and with mirrored images as a control.

    The corridor is its own mirror image, so its control is of images that are turned by a right angle from the way.
    """
    drives = corridor_drives(options, 3 if options.quick else options.corridor_drives)
    report = Report("mcl_corridor", notes=[describe(options.threads), "by night" if options.night else "by day"])
    rows = []
    for kind in mcl_sites.kinds_of(options):
        site = remembering(mcl_sites.site("corridor", mcl_sites.of_kind(options, kind), SETTINGS))
        near = Area(site.area.middles[site.area.middles[:, 0] < PRIOR], site.area.step)
        trials = [run_filter(site, drive, site.params, seed, start_area=near) for seed, drive in enumerate(drives)]
        report.bounds += _bounds(trials, kind, options)
        rows.append((kind, *_figures(trials)))
        if options.control:
            turned = [drive.turned(90.0) for drive in drives]
            trials = [run_filter(site, drive, site.params, seed) for seed, drive in enumerate(turned)]
            rows.append((f"{kind}, images turned by 90 deg", *_figures(trials)))
    head = ("likeness", "drives", "belief right at the end", "TRACKING and right", "ever TRACKING wrongly",
            "images SEARCHING or AMBIGUOUS of the undecided ones", "of them AMBIGUOUS")  # fmt: skip
    report.tables.append(Table("Drives from the first bay to the far end", head, rows))
    return report


def corridor_drives(options: argparse.Namespace, count: int) -> list[Drive]:
    """Return drives from the first bay to the far end: what is ahead of the truth meets the end wall first."""
    studio, lights = mcl_sites.studio("corridor", options), mcl_sites.lights_of(options)
    lights = lights if options.night else lights[:1]
    drives = []
    for number in range(count):
        rng = np.random.default_rng([studio.seed, number, 89])
        x = np.arange(rng.uniform(1.5, 7.5), LAST, STEP)
        line = np.column_stack([x, np.full(len(x), OFFSETS[number % len(OFFSETS)]), np.zeros(len(x))])
        drives.append(studio.record(line, number, light=lights[number % len(lights)]))
    return drives


def _figures(trials: Sequence[Trial]) -> tuple[str, ...]:
    end = sum(bool(trial.is_right[-1]) for trial in trials)
    found = sum(trial.has_converged for trial in trials)
    false = sum(trial.num_false > 0 for trial in trials)
    open_ = np.concatenate([~trial.is_right for trial in trials])
    careful = np.concatenate([~trial.is_trusted for trial in trials])
    ambiguous = np.concatenate([trial.is_ambiguous for trial in trials])
    share, named = np.mean(careful[open_]) if open_.any() else 1.0, np.mean(ambiguous[open_]) if open_.any() else 0.0
    return str(len(trials)), str(end), str(found), str(false), f"{share:.0%}", f"{named:.0%}"


def _bounds(trials: Sequence[Trial], kind: str, options: argparse.Namespace) -> list[Bound]:
    false = float(sum(trial.num_false for trial in trials))
    tracking = 100.0 * float(np.mean([trial.has_converged for trial in trials]))
    of = ("" if kind == "gradients" else f"{kind}: ") + ("by night: " if options.night else "")
    return [
        Bound(f"{of}TRACKING at the right place at the end", 90.0, tracking, "%", True),
        Bound(f"{of}images TRACKING at a wrong place", 0.0, false, ""),
    ]
