"""A vehicle that is carried off while it is localised: how soon that is noticed, and how soon it is found again."""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import Drive
from benchmarks.mcl_routes import kidnapped_line
from benchmarks.mcl_trials import Trial, run_filter
from benchmarks.report import Bound, Report, Table
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State

HELP = "MCL in the town: carried off at image 20; and drives of 40 images that were not: doubts of a right place"
NUM_STARTS = 12
HALF = 20  # images before and after
STEP = 1.0  # m
SOON, NEAR_LOST, FAR = 5, 12, 10.0  # images until DEGRADED and LOST; what counts as carried off, m


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare no more than the others."""


def run(options: argparse.Namespace) -> Report:
    """Drive, be carried off, drive on."""
    site, plan = mcl_sites.town(options)
    studio = mcl_sites.studio("town", options)
    count = 4 if options.quick else options.starts or NUM_STARTS
    drives = []
    for number in range(count):
        rng = np.random.default_rng([studio.seed, number, 97])
        drives.append(studio.record(kidnapped_line(plan, 2 * HALF, STEP, rng), number))
    quiet = [run_filter(site, drive, site.params, number) for number, drive in enumerate(drives)]
    pairs = [(a, b) for a, b in zip(drives, drives[1:] + drives[:1], strict=True) if _way_off(a, b) > FAR]
    moved = [run_filter(site, splice(a, b), site.params, number) for number, (a, b) in enumerate(pairs)]
    held = [trial for trial in moved if trial.is_tracking[HALF - 1] and trial.is_right[HALF - 1]]
    report = Report("mcl_kidnap", notes=[describe(options.threads)])
    doubts, images = _doubts(quiet)
    degraded = np.array([_first(trial, _is_not_tracking(trial)) for trial in held], float)
    lost = np.array([_first(trial, ~trial.is_trusted) for trial in held], float)
    found = [trial.has_converged for trial in held]
    report.bounds += [
        Bound("right place: first doubts, of images in TRACKING", 0.1, 100.0 * doubts / max(images, 1), "%"),
        Bound("carried off: images until TRACKING ends, median", SOON, _median(degraded), ""),
        Bound("carried off: images until no pose leaves, worst", NEAR_LOST, float(lost.max(initial=0.0)), ""),
    ]
    row = (
        str(len(held)),
        " ".join(f"{n:.0f}" for n in sorted(degraded)),
        " ".join(f"{n:.0f}" for n in sorted(lost)),
        f"{sum(found)}",
        f"{doubts} of {images}",
    )
    head = ("carried off", "images until TRACKING ends", "until no pose leaves", f"found by {HALF}", "false doubts")
    report.tables.append(Table("Carried off", head, [row]))
    return report


def splice(before: Drive, after: Drive) -> Drive:
    """Return the first half of one drive and the second half of another, odometry as if the wheels had stood still."""
    odometry = before.odometry[:HALF].copy()
    poses = [odometry[-1]]
    for index in range(HALF, 2 * HALF):
        motion = relative_motion(after.odometry[index - 1], after.odometry[index])
        poses.append(compose_planar(poses[-1][None], motion)[0])
    T_map_base = SE3.from_matrix(np.concatenate([before.T_map_base.matrix[:HALF], after.T_map_base.matrix[HALF:]]))
    return replace(
        before,
        images=np.concatenate([before.images[:HALF], after.images[HALF:]]),
        T_map_base=T_map_base,
        odometry=np.concatenate([odometry, poses[1:]]),
        tilts=np.concatenate([before.tilts[:HALF], after.tilts[HALF:]]),
    )


def _way_off(before: Drive, after: Drive) -> float:
    return float(np.hypot(*(before.truth(HALF - 1) - after.truth(HALF))[:2]))


def _is_not_tracking(trial: Trial) -> NDArray[np.bool_]:
    return ~trial.is_tracking


def _first(trial: Trial, is_so: NDArray[np.bool_]) -> int:
    """Return the number of images after the vehicle was carried off until something is so; one more than all: never."""
    later = np.flatnonzero(is_so[HALF:])
    return int(later[0]) + 1 if len(later) else len(trial.states) - HALF + 1


def _median(values: NDArray[np.float64]) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _doubts(trials: list[Trial]) -> tuple[int, int]:
    """Return how often TRACKING of the right place ended, and the images in TRACKING."""
    doubts = images = 0
    for trial in trials:
        is_tracking = trial.is_tracking & trial.is_right
        images += int(is_tracking.sum())
        after = np.array([state is not State.TRACKING for state in trial.states[1:]])
        doubts += int(np.sum(is_tracking[:-1] & after))
    return doubts, images
