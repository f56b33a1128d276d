"""Cameras that see a part of the sphere, located in the bare cloud of the town from nowhere."""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import LENSES
from benchmarks.mcl_routes import kidnapped_line
from benchmarks.mcl_trials import Trial, run_filter
from benchmarks.report import Bound, Report, Table

HELP = "MCL in the town with a 100 degree pinhole and 190 degree fisheye cameras, from nowhere"
NUM_IMAGES = 40
NUM_STARTS = 15
STEP = 1.0  # m
MIN_SHARE = 80.0  # of the starts that count as 'converges, too', %


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--cameras", default=",".join(LENSES), help="cameras, of these (all)")


def run(options: argparse.Namespace) -> Report:
    """Start everywhere with every camera."""
    site, plan = mcl_sites.town(options)
    studio = mcl_sites.studio("town", options)
    report, rows = Report("mcl_cameras", notes=[describe(options.threads)]), []
    for name in options.cameras.split(","):
        if name not in LENSES:
            raise ValueError(f"--cameras: expected some of {', '.join(LENSES)}, found {name!r}")
        lens = LENSES[name]
        trials = []
        for number in range(5 if options.quick else options.starts or NUM_STARTS):
            rng = np.random.default_rng([studio.seed, number, 97])
            drive = studio.record(kidnapped_line(plan, NUM_IMAGES, STEP, rng), number, lens)
            trials.append(run_filter(site, drive, site.params, number))
        rows.append((name, *_figures(trials)))
        share = 100.0 * float(np.mean([trial.has_converged for trial in trials]))
        report.bounds.append(
            Bound(f"{name}: TRACKING at the right place at image {NUM_IMAGES}", MIN_SHARE, share, "%", True)
        )
        false = float(sum(trial.num_false > 0 for trial in trials))
        report.bounds.append(Bound(f"{name}: starts with TRACKING at a wrong place", 0.0, false, ""))
    head = ("camera", "starts", "found by image 20", f"by image {NUM_IMAGES}", "median error [m]", "heading [deg]")
    report.tables.append(Table("Kidnapped starts by camera", head, rows))
    return report


def _figures(trials: list[Trial]) -> tuple[str, ...]:
    good = [trial for trial in trials if trial.has_converged]
    early = sum(0 < trial.first <= 20 for trial in good)
    meters = np.median([trial.meters[-1] for trial in good]) if good else np.nan
    degrees = np.median([trial.degrees[-1] for trial in good]) if good else np.nan
    return str(len(trials)), str(early), str(len(good)), f"{meters:.2f}", f"{degrees:.1f}"
