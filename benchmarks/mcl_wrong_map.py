"""Is a place claimed where none can be right? Images of one town in the cloud of another, or from beside the map."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import Drive
from benchmarks.mcl_routes import kidnapped_line, limits
from benchmarks.mcl_town import NUM_IMAGES, STEP, kidnapped
from benchmarks.mcl_trials import NEAR_DEG, NEAR_M, Trial, run_filter
from benchmarks.report import Bound, Report, Table
from cycab_sim.town import Plan, draw_plan

HELP = "MCL in the cloud of another town, and off the map: nothing may be claimed"
NUM_STARTS = 24
MAX_CLAIMS = 0.5  # of the starts, %
FOUND = 95.0  # of the starts in the right map, %
KEPT = 0.5  # of the town that is the map, where the images are from the other part


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--map-seed", type=int, default=11, help="seed of the town whose cloud is the map (11)")
    parser.add_argument("--images-seed", type=int, default=12, help="seed of the town of the images; the same: right")
    parser.add_argument("--off-map", action="store_true", help="half of the town is the map, images of the other half")


def run(options: argparse.Namespace) -> Report:
    """Start everywhere; count what is claimed."""
    num_starts = 6 if options.quick else options.starts or NUM_STARTS
    plan, changes = draw_plan(options.map_seed), {}
    x0, y0, x1, y1 = limits(plan)
    if options.off_map:
        changes = {"area.limits": f"{x0:.2f},{y0:.2f},{x0 + KEPT * (x1 - x0):.2f},{y1:.2f}"}
    map_options = argparse.Namespace(**vars(options) | {"world_seed": options.map_seed})
    image_options = argparse.Namespace(**vars(options) | {"world_seed": options.images_seed})
    site = mcl_sites.site("town", map_options, mcl_sites.town_settings(plan, changes))
    studio = mcl_sites.studio("town", image_options)
    if options.off_map:
        drives = [
            studio.record(line, 500 + n)
            for n, line in enumerate(_beside(draw_plan(options.images_seed), x0 + KEPT * (x1 - x0), num_starts))
        ]
    else:
        drives = kidnapped(studio, draw_plan(options.images_seed), num_starts)
    is_right = options.map_seed == options.images_seed and not options.off_map
    trials = [run_filter(site, drive, site.params, seed) for seed, drive in enumerate(drives)]
    report = Report("mcl_wrong_map", notes=[describe(options.threads), _note(options)])
    report.bounds += _right_bounds(trials) if is_right else _wrong_bounds(trials)
    report.tables.append(_table(trials, drives))
    return report


def _beside(plan: Plan, edge: float, count: int) -> list[np.ndarray]:
    """Return drives all of whose poses are beyond x = `edge`, by more than what a place may be off."""
    rng = np.random.default_rng([7, count])
    found: list[np.ndarray] = []
    while len(found) < count:
        line = kidnapped_line(plan, NUM_IMAGES, STEP, rng)
        if np.all(line[:, 0] > edge + 2.0):
            found.append(line)
    return found


def _right_bounds(trials: Sequence[Trial]) -> list[Bound]:
    found = 100.0 * float(np.mean([trial.has_converged for trial in trials]))
    false = float(sum(trial.num_false > 0 for trial in trials))
    return [
        Bound(f"right map: TRACKING at the right place at image {NUM_IMAGES}", FOUND, found, "%", True),
        Bound(f"starts with TRACKING beyond {NEAR_M:g} m or {NEAR_DEG:g} deg", 0.0, false, ""),
    ]


def _wrong_bounds(trials: Sequence[Trial]) -> list[Bound]:
    claimed = 100.0 * float(np.mean([trial.is_tracking.any() for trial in trials]))
    return [Bound("starts with TRACKING anywhere, where none can be right", MAX_CLAIMS, claimed, "%")]


def _table(trials: Sequence[Trial], drives: Sequence[Drive]) -> Table:
    head = (
        "starts",
        "images",
        "ever TRACKING",
        "wrongly",
        "smallest p_chance, median",
        "smallest of all",
        "ms, median",
    )
    smallest = [float(trial.p_chance.min()) for trial in trials]
    row = (
        str(len(trials)),
        str(sum(len(drive) for drive in drives)),
        str(sum(trial.is_tracking.any() for trial in trials)),
        str(sum(trial.num_false > 0 for trial in trials)),
        f"{np.median(smallest):.1e}",
        f"{min(smallest):.1e}",
        f"{np.median(np.concatenate([trial.milliseconds for trial in trials])):.0f}",
    )
    return Table("What was claimed", head, [row])


def _note(options: argparse.Namespace) -> str:
    place = "the other half of the town" if options.off_map else f"images of town {options.images_seed}"
    return f"map of town {options.map_seed}, {place}"
