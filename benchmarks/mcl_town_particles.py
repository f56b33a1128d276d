"""How many particles a kidnapped start needs, with orientation adjustment and without (N17 section IV)."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_town import kidnapped
from benchmarks.mcl_trials import remembering, run_filter
from benchmarks.report import Bound, Report, Table
from typed_params import build, to_mapping

HELP = "MCL in the town: share of kidnapped starts found by number of particles, headings adjusted or not"
COUNTS = {"adjusted": (30, 60, 125, 250, 500, 1000), "not adjusted": (125, 250, 500, 1000, 2000, 4000)}
CHANGES = {"adjusted": {}, "not adjusted": {"adjustment.initial": 0.0}}
LEVEL = 90.0  # share of the starts at which the needed numbers are compared, %
Curves = dict[str, dict[int, float]]


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--curve-starts", type=int, default=30, help="kidnapped starts for each number (30)")


def run(options: argparse.Namespace) -> Report:
    """Measure both curves over the same starts."""
    site, plan = mcl_sites.town(options)
    site = remembering(site)
    drives = kidnapped(mcl_sites.studio("town", options), plan, 8 if options.quick else options.curve_starts)
    curves: Curves = {}
    for name, counts in COUNTS.items():
        for count in counts:
            settings = {"resampling.num_particles": count, "resampling.min_particles": min(count, 300)}
            params = build(type(site.params), to_mapping(site.params) | settings | CHANGES[name])
            found = [run_filter(site, drive, params, seed).has_converged for seed, drive in enumerate(drives)]
            curves.setdefault(name, {})[count] = 100.0 * float(np.mean(found))
    report = Report("mcl_town_particles", notes=[describe(options.threads)])
    rows = [(name, *_cells(curve)) for name, curve in curves.items()]
    numbers = sorted({count for counts in COUNTS.values() for count in counts})
    head = ("headings", *(str(number) for number in numbers))
    report.tables.append(Table(f"Starts found by image 20, of {len(drives)}, by number of particles", head, rows))
    ratio = needed(curves["not adjusted"]) / needed(curves["adjusted"])
    what = f"particles for {LEVEL:g} % of the starts, without adjustment by with it (paper: about 4)"
    report.bounds.append(Bound(what, 2.0, ratio, "", True))
    options.output.mkdir(parents=True, exist_ok=True)
    report.notes.append(f"picture: {draw(curves, options.output / 'mcl_town_particles.png')}")
    return report


def needed(curve: dict[int, float]) -> float:
    """Return the number of particles at which a curve reaches the level, between its points by the logarithm.

    Beyond the last number, where it never does: twice that number.
    """
    counts = sorted(curve)
    for before, after in zip([None, *counts], counts, strict=False):
        if curve[after] < LEVEL:
            continue
        if before is None:
            return float(after)
        share = (LEVEL - curve[before]) / (curve[after] - curve[before])
        return float(before * (after / before) ** share)
    return 2.0 * counts[-1]


def draw(curves: Curves, path: Path) -> Path:
    """Draw the curves; return the path of the picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    for name, curve in curves.items():
        axes.plot(sorted(curve), [curve[count] for count in sorted(curve)], marker="o", label=f"headings {name}")
    axes.set(xscale="log", xlabel="particles", ylabel="kidnapped starts found by image 20 [%]", ylim=(-3, 103))
    axes.axhline(LEVEL, color="grey", linewidth=0.8, linestyle="--")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=130)
    return path


def _cells(curve: dict[int, float]) -> list[str]:
    numbers = sorted({count for counts in COUNTS.values() for count in counts})
    return [f"{curve[number]:.0f} %" if number in curve else "" for number in numbers]
