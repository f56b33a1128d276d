"""`python -m benchmarks ablation [NAME ...] --seed N --size quick`: what each mechanism buys.

A mechanism is switched off by something put in its place here; the product has no switch. The benchmark that judges it
is run as it is, once, and without each of its mechanisms, of the same seed. A last column says by how much each figure
changes without it.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.machine import set_threads
from benchmarks.report import Bound, Report, Table
from sphere_nav.localization.status import FINE

COLUMNS = ("what", "bound", "with", "without", "worse by")


@dataclass(frozen=True)
class Mechanism:
    """What is replaced, by its dotted names; the group and the name of the benchmark that judges it."""

    group: str
    name: str
    targets: tuple[str, ...]
    instead: Callable[..., Any]


def _nothing(*_: Any, **__: Any) -> None:
    """Find nothing."""


def _nowhere(image: Any, *_: Any, **__: Any) -> Any:
    """Return no pixel of an image."""
    return np.zeros(image.shape[:2], np.bool_)


def _chance_by_rivals(values: Any, *_: Any) -> tuple[float, float]:
    return 0.0, float(np.exp((values[1] - values[0]) / 0.6))


JOINING, LOOPS = "sphere_mapping.experiences.joining", "sphere_mapping.graph.loop_closure"
RANGE, TRACKING = "sphere_mapping.acquisition.range", "sphere_mapping.graph.tracking"
FALSE_JOINS, LONG_MAP, CLASSES = ("safety", "false_joins"), ("mapping", "long_map"), ("mapping", "range_classes")
WRONG_MAPS, CONTRADICTIONS = ("bare", "wrong_maps"), ("bare", "contradictions")
FAULTS, JUDGE, TRACK = ("safety", "localizer_faults"), "dense_localizer.judge", "dense_localizer.track"
MECHANISMS = {
    "joined": Mechanism(*FAULTS, ("dense_localizer.motion_prior.Prediction.join",), lambda _, *measured: measured),
    "last_image": Mechanism(*FAULTS, (f"{TRACK}.visual_odometry.VisualOdometry._propagate",), _nothing),
    "otherwise": Mechanism(*FAULTS, (f"{JUDGE}.integrity._ask_otherwise",), lambda candidate, *_: candidate),
    "turns": Mechanism(*FAULTS, ("dense_localizer.motion_prior.InterFrame.refine",), _nothing),
    "biases": Mechanism(
        *FAULTS, (f"{JUDGE}.integrity.remove_bias",), lambda alignment, _: (alignment, np.zeros((6, 6)))
    ),
    "parts_of_views": Mechanism(*FAULTS, (f"{JUDGE}.integrity.align_by_parts",), lambda alignment, *_: alignment),
    "masks": Mechanism(*FAULTS, (f"{JUDGE}.lens_watch.ViewMask.observe",), _nothing),
    "delays": Mechanism(*FAULTS, (f"{JUDGE}.odometry_check.OdometryCheck._find_delay",), lambda _: FINE),
    "places": Mechanism(*FAULTS, (f"{JUDGE}.odometry_check.OdometryCheck._check_place",), _nothing),
    "rival": Mechanism(*FALSE_JOINS, (f"{JOINING}.find_rival",), lambda *_: 0.0),
    "parts": Mechanism(*FALSE_JOINS, (f"{JOINING}.confirm_by_parts",), _nothing),
    "parts_search": Mechanism(*FALSE_JOINS, (f"{JOINING}.search_by_parts",), lambda *_: []),
    "closely": Mechanism(*FALSE_JOINS, (f"{JOINING}.join_closely",), lambda base, drive, joined, *_: joined),
    "alike": Mechanism(*LONG_MAP, (f"{LOOPS}.find_candidates",), lambda *_: []),
    "seen": Mechanism(*LONG_MAP, (f"{LOOPS}.seen_pairs",), lambda *_, **__: []),
    "parts_edge": Mechanism(*LONG_MAP, (f"{TRACKING}.measure_motion_by_parts",), _nothing),
    "features": Mechanism(*LONG_MAP, (f"{TRACKING}.find_motion",), _nothing),
    "rotation": Mechanism(*LONG_MAP, (f"{TRACKING}.guess_by_rotation",), lambda now, before, T, *_: T),
    "borrowed": Mechanism(*CLASSES, (f"{RANGE}.matching.is_borrowed",), lambda top, *_, **__: _nowhere(top)),
    "unknown": Mechanism(*CLASSES, (f"{RANGE}.matching.at_unknown", f"{RANGE}.sweep.at_unknown"), _nowhere),
    "jumps": Mechanism(*CLASSES, (f"{RANGE}.matching.at_jumps",), _nowhere),
    "unlike": Mechanism(*CLASSES, (f"{RANGE}.sweep.is_unlike",), _nowhere),
    "clearly_least": Mechanism(
        *CLASSES, (f"{RANGE}.semi_global.compare_costs",), lambda *images, **_: np.full(images[2].shape, np.inf)
    ),
    "recenter": Mechanism(*CLASSES, (f"{RANGE}.vertical.in_own_directions",), lambda *planes: planes[:2]),
    "chance": Mechanism(*WRONG_MAPS, ("mcl_depth.belief.evidence.chances_of_place",), _chance_by_rivals),
    "injection": Mechanism(*WRONG_MAPS, ("mcl_depth.filter.inject_at_places",), lambda particles, *_: particles),
    "headings": Mechanism(*WRONG_MAPS, ("mcl_depth.filter.adjust_headings",), lambda particles, *_: particles),
    "image_motion": Mechanism(*CONTRADICTIONS, ("mcl_depth.belief.image_motion.View",), _nothing),
}  # fmt: skip


def main(parser: argparse.ArgumentParser, words: list[str]) -> int:
    """Print a table for each mechanism that is named, or for all."""
    options = parser.parse_args(words)
    set_threads(options.threads)
    if unknown := [name for name in options.names if name not in MECHANISMS]:
        parser.error(f"NAME: expected one of {', '.join(MECHANISMS)}, found {unknown[0]}")
    chosen = {name: MECHANISMS[name] for name in options.names or MECHANISMS}
    whole: dict[str, Report] = {}
    for name, one in chosen.items():
        judge = importlib.import_module(f"benchmarks.{one.group}.{one.name}")
        if one.name not in whole:
            whole[one.name] = judge.run(options)
        with ExitStack() as stack:
            for target in one.targets:
                stack.enter_context(patch(target, one.instead))
            without = judge.run(options)
        print(compare(name, one, whole[one.name], without).markdown(), end="\n\n", flush=True)
        for note, other in zip(whole[one.name].notes[1:], without.notes[1:], strict=True):
            print(f"with: {note}\nwithout: {other}\n")
    return 0


def compare(name: str, one: Mechanism, whole: Report, without: Report) -> Table:
    """Return the figures of a benchmark with and without a mechanism."""
    pairs = zip(whole.bounds, without.bounds, strict=True)
    rows = [(a.what, a.cells[1], a.cells[2], b.cells[2], f"{_worse(a, b):+.3g}") for a, b in pairs]
    return Table(f"{one.group} {one.name} without {name}", COLUMNS, rows)


def _worse(a: Bound, b: Bound) -> float:
    return (a.measured - b.measured) * (1.0 if a.is_minimum else -1.0)
