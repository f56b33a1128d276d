"""Ramps of 8 % with an IMU against flat ground, in a street as a bare cloud; without the IMU as a control."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import Drive
from benchmarks.mcl_sites import Settings
from benchmarks.mcl_trials import Trial, run_filter
from benchmarks.report import Bound, Report, Table

HELP = "MCL on ramps of 8 % with an IMU, against flat ground and against no IMU"
STEP = 1.0  # m
BEGIN, END = 0.0, 128.0  # of the drives along x, m
RAMPS = ((20.0, 60.0), (80.0, 120.0))  # m
EDGE = 2.0  # around the kinks that belongs to neither, m
OFFSETS = (-0.5, 0.6, -1.2, 1.0, -0.8, 0.2)  # of the drives from the middle of the street, m
SETTINGS: Settings = {"area.limits": "-18,-18,146,18"}


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--ramp-drives", type=int, default=4, help=f"drives up and down (4, at most {len(OFFSETS)})")


def run(options: argparse.Namespace) -> Report:
    """Drive over the ramps in both directions."""
    site = mcl_sites.site("ramp", options, SETTINGS)
    drives = ramp_drives(options, 2 if options.quick else min(options.ramp_drives, len(OFFSETS)))
    report = Report("mcl_ramp", notes=[describe(options.threads)])
    rows, errors = [], {}
    for name, has_imu in (("IMU", True), ("control: no IMU", False)):
        trials = [run_filter(site, drive, site.params, seed, has_imu=has_imu) for seed, drive in enumerate(drives)]
        errors[name] = parts(drives, trials)
        rows += [(name, part, *_figures(values)) for part, values in errors[name].items()]
        if has_imu:
            false = float(sum(trial.num_false for trial in trials))
            report.bounds.append(Bound(f"{name}: images TRACKING at a wrong place", 0.0, false, ""))
    flat, ramp = (float(np.median(errors["IMU"][part])) for part in ("flat", "ramp"))
    report.bounds.insert(0, Bound("IMU: median error on ramps, by that on flat ground", 1.5, ramp / flat, ""))
    head = ("variant", "ground", "images with a pose", "median [m]", "95 % [m]", "largest [m]")
    report.tables.append(Table("Error after the first TRACKING", head, rows))
    return report


def ramp_drives(options: argparse.Namespace, count: int) -> list[Drive]:
    """Return drives along the street, every other one back."""
    studio, x = mcl_sites.studio("ramp", options), np.arange(BEGIN, END, STEP)
    drives = []
    for number, offset in enumerate(OFFSETS[:count]):
        is_back = number % 2 == 1
        line = np.column_stack([x[::-1] if is_back else x, np.full(len(x), offset), np.full(len(x), np.pi * is_back)])
        drives.append(studio.record(line, number))
    return drives


def parts(drives: Sequence[Drive], trials: Sequence[Trial]) -> dict[str, NDArray[np.float64]]:
    """Return the errors in m of all images with a pose after the first TRACKING, on flat ground and on the ramps."""
    flat, ramp = [], []
    for drive, trial in zip(drives, trials, strict=True):
        x = np.array([drive.truth(index)[0] for index in range(len(drive))])
        begin = np.argmax(trial.is_tracking) if trial.is_tracking.any() else len(drive)
        is_used = trial.is_trusted & (np.arange(len(drive)) >= begin)
        is_up = np.any([(x > low + EDGE) & (x < high - EDGE) for low, high in RAMPS], axis=0)
        is_level = np.all([(x < low - EDGE) | (x > high + EDGE) for low, high in RAMPS], axis=0)
        ramp.append(trial.meters[is_used & is_up])
        flat.append(trial.meters[is_used & is_level])
    return {"flat": np.concatenate(flat), "ramp": np.concatenate(ramp)}


def _figures(errors: NDArray[np.float64]) -> tuple[str, ...]:
    if not len(errors):
        return "0", "-", "-", "-"
    median, most, largest = np.median(errors), np.percentile(errors, 95), errors.max()
    return str(len(errors)), f"{median:.2f}", f"{most:.2f}", f"{largest:.2f}"
