"""The corridor of 160 m where every bay looks like the next (N17 section V): without and with what copes with it."""

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
from cycab_sim.worlds import CORRIDOR
from mcl_depth.geometry.area import Area
from mcl_depth.params import FilterParams
from typed_params import build

HELP = "MCL in a corridor of equal bays: collapse without recovery and hypotheses, success with them"
STEP = 2.0  # m
PRIOR = 40.0  # particles are spread over so much of the corridor at the start, as in N17, m
LAST = 156.0  # where the drives end, m
OFFSETS = (0.0, 0.35, -0.35)  # from the middle, m
SETTINGS: Settings = {  # of N17 table I, column Corridor
    "cache.max_distance": 0.25,
    "resampling.num_particles": 1000,
    "synthesis.elevation_min_deg": -25.5,
    "synthesis.elevation_max_deg": 25.5,
    "area.step": 0.25,
    "synthesis.voxel_m": mcl_sites.SPACING,
    "synthesis.num_columns": 180,
    "comparison.lcn_radius_px": 5,
    "weight.min_effective_share": 0.5,  # one image of a bay like all others decides nothing
    "recovery.lost_share": 0.0,  # several places are no reason for new particles
    "state.patience": 1000,  # nor to begin anew
    "state.min_lead": 0.0,  # no bay stands out from the others: what is left counts
    "area.limits": f"0.3,-2.5,{CORRIDOR - 0.3:.1f},2.5",
}
PLAIN: Settings = {  # algorithm 2 and nothing else
    "weight.scaling": "minmax",
    "weight.min_effective_share": 0.0,
    "resampling.roughening": 0.0,
    "recovery.is_active": False,
    "resampling.is_adaptive": False,
}


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--corridor-drives", type=int, default=6, help="drives from the first bay to the far end (6)")


def run(options: argparse.Namespace) -> Report:
    """Drive from the first bay to the far end."""
    site = remembering(mcl_sites.site("corridor", options, SETTINGS))
    drives = corridor_drives(options, 3 if options.quick else options.corridor_drives)
    report = Report("mcl_corridor", notes=[describe(options.threads)])
    rows = []
    for name, changes in (("algorithm 2 alone", PLAIN), ("with recovery and hypotheses", {})):
        params = build(FilterParams, SETTINGS | changes)
        near = Area(site.area.middles[site.area.middles[:, 0] < PRIOR], site.area.step)
        trials = [run_filter(site, drive, params, seed, start_area=near) for seed, drive in enumerate(drives)]
        rows.append((name, *_figures(trials)))
        report.bounds += _bounds(name, trials, is_plain=bool(changes))
    head = ("variant", "drives", "belief right at the end", "TRACKING and right", "ever TRACKING wrongly",
            "images SEARCHING or AMBIGUOUS of the undecided ones", "of them AMBIGUOUS")  # fmt: skip
    report.tables.append(Table("Drives from the first bay to the far end", head, rows))
    return report


def corridor_drives(options: argparse.Namespace, count: int) -> list[Drive]:
    """Return drives from the first bay to the far end: what is ahead of the truth meets the end wall first."""
    studio = mcl_sites.studio("corridor", options)
    drives = []
    for number in range(count):
        rng = np.random.default_rng([studio.seed, number, 89])
        x = np.arange(rng.uniform(1.5, 7.5), LAST, STEP)
        line = np.column_stack([x, np.full(len(x), OFFSETS[number % len(OFFSETS)]), np.zeros(len(x))])
        drives.append(studio.record(line, number))
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


def _bounds(name: str, trials: Sequence[Trial], *, is_plain: bool) -> list[Bound]:
    share = 100.0 * float(np.mean([trial.is_right[-1] for trial in trials]))
    if is_plain:
        return [Bound(f"{name}, must fail: belief at the right place at the end", 50.0, share, "%")]
    false = float(sum(trial.num_false for trial in trials))
    tracking = 100.0 * float(np.mean([trial.has_converged for trial in trials]))
    ambiguous = float(np.mean([trial.is_ambiguous.any() for trial in trials]) * 100.0)
    return [
        Bound(f"{name}: TRACKING at the right place at the end", 90.0, tracking, "%", True),
        Bound(f"{name}: images TRACKING at a wrong place", 0.0, false, ""),
        Bound(f"{name}: drives that were called AMBIGUOUS on the way", 90.0, ambiguous, "%", True),
    ]
