"""Run times of mcl_depth in a town of 100 x 100 m: the map made ready, its steps, an image of a drive from nowhere."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.bare.drives import LENSES, LIGHTS, Studio, kidnapped
from benchmarks.bare.trials import run_filter, town
from benchmarks.machine import repeat_cpu
from benchmarks.report import Bound, Headline, Report, Table
from mcl_depth.likeness.comparison import depth_features_many, similarity_many, visual_features
from mcl_depth.warm_up import warm_up

HELP = "mcl_depth: the map made ready, synthesis, comparison, first image, image after convergence"
NUM_IMAGES, NUM_PLACES, NUM_RUNS = {"quick": 25, "full": 40}, 64, 5


def run(options: argparse.Namespace) -> Report:
    """Measure all of it."""
    report, rows = Report("mcl_times"), []
    with tempfile.TemporaryDirectory() as folder:
        open_town = partial(town, options.seed, folder=folder)
        for name in ("nothing on disk", "started again"):
            seconds, cpu, (site, plan) = _clocked(open_town)
            rows.append((name, f"{seconds:.1f}", f"{cpu:.1f}"))
    report.tables.append(Table(f"The map made ready, {len(site.places)} places", ("map", "s", "of processor s"), rows))
    report.bounds.append(Bound("map on disk: ready after, of processor", 5.0, cpu, "s"))
    warm_up(site.params)
    middles = site.area.middles[:: max(len(site.area.middles) // NUM_PLACES, 1)][:NUM_PLACES]
    places = np.column_stack([middles, site.depth_map.heights(middles)])
    ranges = site.synthesizer.synthesize_many(places)
    stack, visual = depth_features_many(ranges, site.params.comparison), visual_features(np.nan_to_num(ranges[0]))
    steps: dict[str, Callable[[], Any]] = {
        "synthesis": partial(site.synthesizer.synthesize_many, places),
        "features": partial(depth_features_many, ranges, site.params.comparison),
        "comparison, 36 headings": partial(similarity_many, visual, stack, 36),
        "comparison, all headings": partial(similarity_many, visual, stack, ranges.shape[2]),
    }
    each = {name: float(np.median(repeat_cpu(call, NUM_RUNS, 1))) / len(places) for name, call in steps.items()}
    title = f"A panorama of {ranges.shape[2]} x {ranges.shape[1]}, of a batch of {len(places)}"
    report.tables.append(Table(title, ("step", "CPU of its thread ms"), [(k, f"{v:.3f}") for k, v in each.items()]))
    report.bounds.append(Bound("synthesis of a panorama", 4.0, each["synthesis"], "ms"))
    (drive,) = kidnapped(
        Studio("town", options.seed), plan, 1, NUM_IMAGES[options.size], LENSES["panorama"], LIGHTS[:1]
    )
    trial = run_filter(site, drive, options.seed)
    later = trial.milliseconds[trial.is_tracking]
    tracking, told = float(np.median(later)) if len(later) else np.nan, Headline("times and memory", "town, 100 m")
    report.bounds += [
        Bound("first image, anywhere in the map, of processor", 2000.0, float(trial.milliseconds[0]), "ms"),
        Bound(f"an image in TRACKING, of processor, median of {len(later)}", 100.0, tracking, "ms", headline=told),
    ]
    return report


def _clocked(call: Callable[[], Any]) -> tuple[float, float, Any]:
    """Return times in s, by clock and of the processor, and the result."""
    begun, used = time.perf_counter(), time.process_time()
    result = call()
    return time.perf_counter() - begun, time.process_time() - used, result
