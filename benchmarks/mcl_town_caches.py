"""What each cache and the adjustment of headings are worth in the town: time and success, one left out at a time."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import Drive
from benchmarks.mcl_sites import Settings
from benchmarks.mcl_town import kidnapped
from benchmarks.mcl_trials import Trial, run_filter
from benchmarks.report import Bound, Report, Table
from mcl_depth.likeness.depth_cache import DepthCache
from mcl_depth.site import Site
from typed_params import build, to_mapping

HELP = "MCL in the town: time and success without the depth cache, the similarity cache, the adjustment of headings"
NUM_STARTS = 4


@dataclass(frozen=True)
class Variant:
    """What is left out: parameters, and whether depth features are forgotten before a start or before every image."""

    name: str
    changes: Settings
    forgets: str = ""


VARIANTS = (
    Variant("everything", {}),
    Variant("depth cache empty at the start", {}, "start"),
    Variant("without depth cache", {}, "image"),
    Variant("without similarity cache", {"cache.uses_similarities": False}),
    Variant("without adjustment of headings", {"adjustment.initial": 0.0}),
)


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--cache-starts", type=int, default=NUM_STARTS, help=f"kidnapped starts ({NUM_STARTS})")


def run(options: argparse.Namespace) -> Report:
    """Run the same starts with each thing left out."""
    site, plan = mcl_sites.town(options)
    drives = kidnapped(mcl_sites.studio("town", options), plan, 2 if options.quick else options.cache_starts)
    run_filter(site, drives[0], site.params, 0)  # compiles
    report, rows = Report("mcl_town_caches", notes=[describe(options.threads)]), []
    for variant in VARIANTS:
        trials = _trials(site, drives, variant)
        first, later = first_ms(trials), later_ms(trials)
        found = sum(trial.has_converged for trial in trials)
        rows.append((variant.name, f"{first:.0f}", f"{later:.0f}", f"{found} of {len(trials)}"))
        if variant.name == "everything":
            report.bounds.append(Bound("an image after convergence, median", 100.0, later, "ms"))
        if variant.forgets == "start":
            report.bounds.append(Bound("first image, nothing known of the map yet", 2000.0, first, "ms"))
    head = ("variant", "first image [ms]", "images 11 to 20, median [ms]", "found by image 20")
    report.tables.append(Table("One thing left out at a time", head, rows))
    return report


def first_ms(trials: Sequence[Trial]) -> float:
    """Return the median time of the first image, all over the map."""
    return float(np.median([trial.milliseconds[0] for trial in trials]))


def later_ms(trials: Sequence[Trial]) -> float:
    """Return the median time of the second half of the images."""
    return float(np.median(np.concatenate([trial.milliseconds[len(trial.milliseconds) // 2 :] for trial in trials])))


def _trials(site: Site, drives: Sequence[Drive], variant: Variant) -> list[Trial]:
    params = build(type(site.params), to_mapping(site.params) | variant.changes)
    trials = []
    for seed, drive in enumerate(drives):
        cache = site.depth_map.cache
        if variant.forgets:
            forget(site)
        before = (lambda: forget(site)) if variant.forgets == "image" else None
        trials.append(run_filter(site, drive, params, seed, before_image=before))
        site.depth_map.cache = cache
    return trials


def forget(site: Site) -> None:
    """Empty the depth cache."""
    camera, megabytes = site.depth_map.camera, site.params.cache.max_megabytes
    site.depth_map.cache = DepthCache(megabytes << 20, camera.height, camera.width)
