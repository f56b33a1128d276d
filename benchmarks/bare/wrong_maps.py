"""Is a place claimed where none can be right? Images of one town in the cloud of another, and from beside the map."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks.bare.drives import LIGHTS, Drive, Trial, build_town, kidnapped, kidnapped_line, record, run_filter
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.world.town import Plan

COUNTS = {"quick": 2, "full": 50}  # drives of each case in each town
TOWNS = {"quick": 1, "full": 4}
MAX_CLAIMS, FOUND = 0.5, 95.0  # of the starts in a wrong map, in the right one, %
AWAY, KEPT = 2.0, 0.5  # m from the map of a drive that is not in it; of the town that is the map then
NUM_IMAGES = 20  # of a drive
HEAD = ("case", "starts", "ever TRACKING", "wrongly", "least p_chance, median", "of all")


def run(options: argparse.Namespace) -> Report:
    """Start everywhere in each pair of map and images; count what is claimed."""
    found: dict[str, list[Trial]] = {"right map": [], "another town": [], "mirrored": [], "the other half": []}
    count = COUNTS[options.size]
    for seed in range(options.seed, options.seed + TOWNS[options.size]):
        here, plan = build_town(seed)
        own, foreign = (kidnapped(town, count, NUM_IMAGES) for town in (seed, seed + 1000))
        for name, drives in (("right map", own), ("another town", foreign), ("mirrored", [d.mirrored for d in own])):
            found[name] += [run_filter(here, drive.steps(), number) for number, drive in enumerate(drives)]
        if options.size == "full":
            half, _ = build_town(seed, KEPT)
            beside = _beside(seed, plan, count)
            found["the other half"] += [run_filter(half, drive.steps(), number) for number, drive in enumerate(beside)]
    report = Report("wrong_maps")
    report.tables.append(Table("What was claimed", HEAD, [(name, *_figures(f)) for name, f in found.items() if f]))
    right = found.pop("right map")
    share, told = 100.0 * float(np.mean([one.has_converged for one in right])), Headline("bare geometry", "towns")
    report.bounds.append(Bound(f"right map, {len(right)} starts: TRACKING and right", FOUND, share, "%", True, told))
    wrong = [one for name in found for one in found[name]]
    for name, these, headline in (*((n, f, None) for n, f in found.items() if f), ("wrong maps", wrong, told)):
        claimed = 100.0 * float(np.mean([one.is_tracking.any() for one in these]))
        what = f"{name}, {len(these)} starts: TRACKING anywhere"
        report.bounds.append(Bound(what, MAX_CLAIMS, claimed, "%", headline=headline))
    return report


def _beside(town: int, plan: Plan, count: int) -> list[Drive]:
    """Return drives all of whose poses are beyond the part of the town that is the map."""
    rng = np.random.default_rng([town, 7])
    edge = plan.east / 2 + AWAY  # `KEPT` of the square around the middle
    lines: list[np.ndarray] = []
    while len(lines) < count:
        line = kidnapped_line(plan, NUM_IMAGES, 1.0, rng)
        if np.all(line[:, 0] > edge):
            lines.append(line)
    share = -(-count // len(LIGHTS))  # one light after the other: shadows are cast once
    return [record(town, line, 500 + n, LIGHTS[n // share]) for n, line in enumerate(lines)]


def _figures(found: Sequence[Trial]) -> tuple[str, ...]:
    least = [float(one.p_chance.min()) for one in found]
    claims, wrong = sum(one.is_tracking.any() for one in found), sum(one.num_false > 0 for one in found)
    return str(len(found)), str(claims), str(wrong), f"{np.median(least):.1e}", f"{min(least):.1e}"
